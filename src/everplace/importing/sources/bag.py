"""ROS 1 bags, ROS 2 bags and MCAP files, one drive each: an image topic, and a topic of positions or poses.

| type | what becomes of it |
|---|---|
| `sensor_msgs/Image` | pixels (see `ros_image`) |
| `sensor_msgs/CompressedImage` | the encoded image as it is |
| `sensor_msgs/NavSatFix` | metres east and north on the plane that touches WGS 84 at the origin; heading of the track |
| `nav_msgs/Odometry`, `geometry_msgs/PoseStamped`, `geometry_msgs/PoseWithCovarianceStamped` | x, y and yaw |
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.formats import image_ending
from everplace.images.sixteen_bits import SixteenBits
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.containers.ros_bag import BAG_ENDINGS, METADATA, Bag, Topic, open_bag
from everplace.importing.containers.ros_image import image_pixels
from everplace.importing.foreign_route import Content, Encoded, ForeignFrame, ForeignRoute
from everplace.importing.positions.geodesy import local_plane, track_headings
from everplace.importing.positions.pose_track import BODY_AXIS, PoseTrack, planar_track, with_poses
from everplace.importing.positions.trajectory import OPTICAL_AXIS, Trajectory, rotation_of
from everplace.importing.recording import Drive, RecordingOptions, passed_over, recorded_route
from everplace.route.natural_order import natural_sorted

__all__ = ["EXTRAS", "SUMMARY", "Options", "read"]

SUMMARY = "a ROS 1 bag, a ROS 2 bag or an MCAP file, or a directory of them, one for each drive"

EXTRAS = {"rosbags": "ros"}
"""Which extra brings the package that reads it."""

_OTHER_ENDINGS = tuple(
    ending + rest
    for ending in sorted(BAG_ENDINGS)
    for rest in (".active", ".orig", ".orig.active", ".zstd", ".zst", ".lz4", ".gz", ".bz2", ".part", ".tmp")
)
"""Endings of bags that cannot be read: still open when recording stopped, compressed, or broken downloads."""

_IMAGE, _COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_FIX = "sensor_msgs/msg/NavSatFix"
_POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)


def _check_origin(origin: tuple[float, ...]) -> tuple[float, ...]:
    if origin and not (len(origin) == 2 and abs(origin[0]) <= 90 and abs(origin[1]) <= 180):
        raise ValueError("it is not a latitude and a longitude in degrees, like 48.2,16.37")
    return origin


class Options(RecordingOptions):
    """Options of the kind."""

    topic: str = ""
    """The image topic; by default the only one."""
    poses: str = ""
    """The topic of positions or poses, or none to leave them out; by default the only one."""
    clock: Literal["header", "recorded"] = "header"
    """Which times count: header, the stamps of the messages, or recorded, when they were written."""
    ahead: Literal["x", "z"] = "x"
    """Which axis of the body, whose poses are recorded, is the camera's: x, or z where they are those of the camera
    itself."""
    origin: Annotated[tuple[float, ...], AfterValidator(_check_origin)] = ()
    """Latitude and longitude from which metres are counted; by default those of the first position."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens one or several bags.

    Raises:
        RouteError: There is no bag, one is damaged, or lacks the topics.
        ConfigError: There are not as many conditions as bags, or a choice between topics is left open.
        MissingExtraError: rosbags is not installed.
    """
    paths = _find_bags(source)
    others = TreePath(source).children().files if source.is_dir() and source.absolute() not in paths else []
    origin = options.origin
    drives: list[Drive] = []
    notes = passed_over(source, others, "bags", _OTHER_ENDINGS)
    for path in paths:
        with open_bag(path) as bag:
            images = _choose(bag, path, "image", "topic", options.topic, (_IMAGE, _COMPRESSED))
            poses = _choose_poses(bag, path, options)
            if poses is not None and _FIX in poses.types and not origin:
                origin = _first_position(bag, poses, path)
        dropping = poses is not None and options.without_pose == "drop"
        frames = _frames(path, images, poses, options, origin)
        drives.append(Drive(path.name if path.is_dir() else path.stem, frames, None if dropping else images.count))
        if poses is None and options.poses != "none":
            notes.append(f"{readable(path)} holds no topic of positions or poses.")
    if origin:
        notes.append(
            f"Positions are metres east and north of latitude {origin[0]:.7f}, longitude {origin[1]:.7f}, on the plane "
            "that touches the WGS 84 ellipsoid there; import other drives of this route with "
            f"--set origin={origin[0]!r},{origin[1]!r}."
        )
    return recorded_route(source, drives, options, notes)


def _find_bags(source: Path) -> list[Path]:
    if not source.is_dir():
        return [source]
    if (source / METADATA).exists():
        return [source.absolute()]
    directories, files = TreePath(source).children()
    names = [name for name in files if name.lower().endswith(tuple(BAG_ENDINGS))]
    names += [name for name in directories if (source / name / METADATA).exists()]
    paths = [source / name for name in natural_sorted(names)]
    if not paths:
        raise RouteError(
            f"{readable(source)} holds no bag ({', '.join(sorted(BAG_ENDINGS))}, or a directory with {METADATA}); give "
            "a bag or a directory of bags"
        )
    return paths


def _choose(bag: Bag, path: Path, what: str, option: str, wanted: str, types: tuple[str, ...]) -> Topic:
    """Returns the wanted topic, or the only one with messages of these types.

    Raises:
        RouteError: There is none.
        ConfigError: There are several, or not the wanted one.
    """
    topics = [topic for topic in bag.topics(types) if topic.count]
    offer = ", ".join(readable(f"{topic.name} ({', '.join(sorted(topic.types))})") for topic in topics)
    if not topics:
        raise RouteError(f"{readable(path)} holds no {what} topic with messages ({', '.join(types)}); check the bag")
    chosen = [topic for topic in topics if topic.name == wanted] if wanted else topics
    if not chosen:
        raise ConfigError(f"{readable(path)} holds no {what} topic {wanted!r}; choose one with --set {option}: {offer}")
    if len(chosen) > 1:
        raise ConfigError(f"{readable(path)} holds several {what} topics; choose one with --set {option}: {offer}")
    if len(chosen[0].types) > 1:
        raise RouteError(
            f"the topic {readable(chosen[0].name)} of {readable(path)} mixes "
            f"{readable(', '.join(sorted(chosen[0].types)))}; record them apart"
        )
    return chosen[0]


def _choose_poses(bag: Bag, path: Path, options: Options) -> Topic | None:
    types = (_FIX, *_POSES)
    if options.poses == "none" or not (options.poses or any(topic.count for topic in bag.topics(types))):
        return None
    return _choose(bag, path, "pose", "poses", options.poses, types)


def _frames(
    path: Path, images: Topic, poses: Topic | None, options: Options, origin: tuple[float, ...]
) -> Iterator[ForeignFrame]:
    with open_bag(path) as bag:
        track = None if poses is None else _read_track(bag, poses, path, options, origin)
        yield from with_poses(_read_images(bag, images, path, options), track, options, path.name)


def _read_images(bag: Bag, topic: Topic, path: Path, options: Options) -> Iterator[ForeignFrame]:
    (message_type,) = topic.types
    number = -1
    scale = options.scale()
    for number, (recorded, message) in enumerate(bag.messages(topic.name, message_type)):
        where = f"message {number} of {topic.name} in {readable(path)}"
        content = _encoded(message, where) if message_type == _COMPRESSED else _pixels(message, where, scale)
        seconds = _seconds(recorded, message, where, options)
        yield ForeignFrame(f"{number:06d}", content, seconds=seconds, scale=scale)
    if number + 1 < topic.count:
        raise RouteError(
            f"{readable(path)} announces {topic.count} messages of {topic.name}, but holds only {number + 1}; reindex "
            "or recover it"
        )


def _pixels(message: Any, where: str, scale: SixteenBits) -> Content:
    try:
        return image_pixels(
            message.encoding,
            message.height,
            message.width,
            message.step,
            np.ascontiguousarray(message.data, dtype=np.uint8),
            big_endian=bool(message.is_bigendian),
            scale=scale,
        )
    except ValueError as error:
        raise RouteError(f"{where} cannot be read: {error}; convert the topic or choose another") from error


def _encoded(message: Any, where: str) -> Content:
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    ending = image_ending(data)
    if not ending:
        raise RouteError(
            f"{where} is no JPEG, PNG, WebP, TIFF or BMP image (its format is {str(message.format)[:60]!r}); convert "
            "the topic or choose another"
        )
    return Encoded(data, ending)


def _seconds(recorded: int, message: Any, where: str, options: Options) -> float:
    if options.clock == "recorded":
        return recorded * 1e-9
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise RouteError(f"{where} has no time stamp; take the times of recording with --set clock=recorded")
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _first_position(bag: Bag, topic: Topic, path: Path) -> tuple[float, float]:
    for _, message in bag.messages(topic.name, _FIX):
        if _is_fixed(message):
            return float(message.latitude), float(message.longitude)
    raise _without_poses(topic, path)


def _is_fixed(message: Any) -> bool:
    """Says whether a receiver knew where it was (status -1: it did not; nor at exactly 0, 0, whatever the status)."""
    latitude, longitude = message.latitude, message.longitude
    return bool(
        message.status.status >= 0 and abs(latitude) <= 90 and abs(longitude) <= 180 and (latitude or longitude)
    )


def _without_poses(topic: Topic, path: Path) -> RouteError:
    return RouteError(
        f"the topic {topic.name} of {readable(path)} holds no position; choose another or none with --set poses"
    )


def _read_track(bag: Bag, topic: Topic, path: Path, options: Options, origin: tuple[float, ...]) -> PoseTrack:
    """Reads all positions or poses of a topic.

    Raises:
        RouteError: There is none, or one is not finite or has no direction.
    """
    (message_type,) = topic.types
    label = f"the topic {topic.name} of {readable(path)}"
    seconds: list[float] = []
    values: list[list[float]] = []
    for number, (recorded, message) in enumerate(bag.messages(topic.name, message_type)):
        where = f"message {number} of {topic.name} in {readable(path)}"
        if message_type == _FIX:
            if not _is_fixed(message):
                continue
            values.append([message.latitude, message.longitude])
        else:
            values.append(_pose_values(message, where))
        seconds.append(_seconds(recorded, message, where, options))
    if not values:
        raise _without_poses(topic, path)
    table = np.array(values, dtype=np.float64)
    if message_type == _FIX:
        order = np.argsort(seconds, kind="stable")
        positions = local_plane(table[order], (origin[0], origin[1]))
        return planar_track(label, np.array(seconds)[order], np.column_stack([positions, track_headings(positions)]))
    axis = BODY_AXIS if options.ahead == "x" else OPTICAL_AXIS
    return PoseTrack(label, Trajectory.of(seconds, table[:, :3].tolist(), rotation_of(table[:, 3:].tolist())), axis)


def _pose_values(message: Any, where: str) -> list[float]:
    """Returns the position and the quaternion x, y, z, w."""
    pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
    position, q = pose.position, pose.orientation
    values = [float(value) for value in (position.x, position.y, position.z, q.x, q.y, q.z, q.w)]
    if not all(map(math.isfinite, values)) or not 0.95 < math.hypot(*values[3:]) < 1.05:
        raise RouteError(
            f"{where} has a position that is not finite or a quaternion whose length is not 1; choose another topic "
            "or none with --set poses"
        )
    return values
