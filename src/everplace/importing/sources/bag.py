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
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.formats import image_ending
from everplace.images.sixteen_bits import SixteenBits
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.containers.ros_bag import BAG_ENDINGS, METADATA, Topic, read_messages, read_topics
from everplace.importing.containers.ros_image import image_pixels
from everplace.importing.foreign_route import Content, Encoded, ForeignFrame, ForeignRoute
from everplace.importing.positions.pose_track import PoseTrack, with_poses
from everplace.importing.recording import Drive, passed_over, recorded_route
from everplace.importing.recording_parts import PartOptions, Recording, find_recordings
from everplace.importing.sources._bag_poses import FIX, POSES, Clock, first_position, read_track, stamp_of
from everplace.route.natural_order import natural_sorted

__all__ = ["EXTRAS", "SUMMARY", "Options", "read", "read_fixes"]

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


def _check_origin(origin: tuple[float, ...]) -> tuple[float, ...]:
    if origin and not (len(origin) == 2 and abs(origin[0]) <= 90 and abs(origin[1]) <= 180):
        raise ValueError("it is not a latitude and a longitude in degrees, like 48.2,16.37")
    return origin


class Options(PartOptions):
    """Options of the kind."""

    topic: str = ""
    """The image topic; by default the only one."""
    poses: str = ""
    """The topic of positions or poses, or none to leave them out; by default the only one."""
    clock: Clock = "header"
    """Which times count: header, the stamps of the messages, or recorded, when they were written."""
    ahead: Literal["x", "z"] = "x"
    """Which axis of the body, whose poses are recorded, is the camera's: x, or z where they are those of the camera
    itself."""
    origin: Annotated[tuple[float, ...], AfterValidator(_check_origin)] = ()
    """Latitude and longitude from which metres are counted; by default those of the first position."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens one or several bags.

    Raises:
        RouteError: There is no bag, one is damaged, or lacks the topics; bags that are joined are not in the order of
            time.
        ConfigError: There are not as many conditions as bags, a choice between topics is left open, or a bag that is
            to be joined is not there.
        MissingExtraError: rosbags is not installed.
    """
    is_bag = (source / METADATA).exists()
    # A name of its own even where the source is given as `.`
    recordings, notes = find_recordings(source.absolute() if is_bag else source, options.join, _bags, whole=is_bag)
    if not recordings:
        raise RouteError(
            f"{readable(source)} holds no bag ({', '.join(sorted(BAG_ENDINGS))}, or a directory with {METADATA}); give "
            "a bag or a directory of bags"
        )
    if source.is_dir() and not is_bag:
        for directory in dict.fromkeys(path.parent for one in recordings for path in one.parts):
            notes += passed_over(directory, TreePath(directory).children().files, "bags", _OTHER_ENDINGS)
    origin = options.origin
    drives: list[Drive] = []
    for recording in recordings:
        paths, label = recording.parts, _label(recording)
        topics = read_topics(paths, (_IMAGE, _COMPRESSED, FIX, *POSES))
        images = _choose(topics, label, "image", "topic", options.topic, (_IMAGE, _COMPRESSED))
        poses = _choose_poses(topics, label, options)
        if poses is None and options.poses != "none":
            notes.append(f"{label} holds no topic of positions or poses.")
        elif poses is not None and FIX in poses.types:
            first = first_position(paths, poses)
            origin = origin or first or ()
            if first is None and not options.poses:
                notes.append(f"The topic {poses.name} of {label} holds no position, so the drive gets no poses.")
                poses = None
        dropping = poses is not None and options.without_pose == "drop"
        frames = _frames(recording, images, poses, options, origin)
        drives.append(Drive(recording.name, frames, None if dropping else images.count))
    if origin:
        notes.append(
            f"Positions are metres east and north of latitude {origin[0]:.7f}, longitude {origin[1]:.7f}, on the plane "
            "that touches the WGS 84 ellipsoid there; import other drives of this route with "
            f"`origin`={origin[0]!r},{origin[1]!r}."
        )
    return recorded_route(source, drives, options, notes)


def read_fixes(bag: Path, origin: tuple[float, ...] = ()) -> tuple[PoseTrack, tuple[float, ...]] | None:
    """Reads where a bag was by satellite, if one topic of it says so; of several it warns.

    Args:
        bag: One bag.
        origin: Latitude and longitude from which metres are counted; empty: those of the first fix.

    Returns:
        The track and its origin; None: no topic has fixes, or several have.

    Raises:
        RouteError: The bag is damaged.
        MissingExtraError: rosbags is not installed.
    """
    topics = read_topics([bag], (FIX,))
    if len(topics) > 1:
        named = ", ".join(readable(topic.name) for topic in topics)
        warnings.warn(
            f"{readable(bag)} holds several topics of satellite fixes ({named}); none was taken", stacklevel=3
        )
    if len(topics) != 1 or topics[0].types != {FIX}:
        return None
    origin = origin or first_position([bag], topics[0]) or ()
    return (read_track([bag], topics[0], readable(bag), "header", "x", origin), origin) if origin else None


def _bags(directory: Path) -> list[str]:
    directories, files = TreePath(directory).children()
    names = [name for name in files if name.lower().endswith(tuple(BAG_ENDINGS))]
    # A directory beside a bag may be one that nobody may look into.
    names += [name for name in directories if os.path.exists(directory / name / METADATA)]  # noqa: PTH110
    return natural_sorted(names)


def _label(recording: Recording) -> str:
    """What a drive is called in messages."""
    first = recording.parts[0]
    return readable(first if len(recording.parts) == 1 else first.parent)


def _choose(found: Sequence[Topic], label: str, what: str, option: str, wanted: str, types: tuple[str, ...]) -> Topic:
    """Returns the wanted topic, or the only one with messages of these types.

    Raises:
        RouteError: There is none.
        ConfigError: There are several, or not the wanted one.
    """
    topics = [topic for topic in found if topic.types.intersection(types)]
    offer = ", ".join(readable(f"{topic.name} ({', '.join(sorted(topic.types))})") for topic in topics)
    if not topics:
        raise RouteError(f"{label} holds no {what} topic with messages ({', '.join(types)}); check the bag")
    chosen = [topic for topic in topics if topic.name == wanted] if wanted else topics
    if not chosen:
        raise ConfigError(f"{label} holds no {what} topic {wanted!r}; choose one with `{option}`: {offer}")
    if len(chosen) > 1:
        raise ConfigError(f"{label} holds several {what} topics; choose one with `{option}`: {offer}")
    if len(chosen[0].types) > 1:
        raise RouteError(
            f"the topic {readable(chosen[0].name)} of {label} mixes "
            f"{readable(', '.join(sorted(chosen[0].types)))}; record them apart"
        )
    return chosen[0]


def _choose_poses(found: Sequence[Topic], label: str, options: Options) -> Topic | None:
    types = (FIX, *POSES)
    if options.poses == "none" or not (options.poses or any(topic.types.intersection(types) for topic in found)):
        return None
    return _choose(found, label, "pose", "poses", options.poses, types)


def _frames(
    recording: Recording, images: Topic, poses: Topic | None, options: Options, origin: tuple[float, ...]
) -> Iterator[ForeignFrame]:
    paths = recording.parts
    track = None if poses is None else read_track(paths, poses, _label(recording), options.clock, options.ahead, origin)
    drive = paths[0].name if len(paths) == 1 else recording.name
    yield from with_poses(_read_images(paths, images, options), track, options, drive)


def _read_images(paths: Sequence[Path], topic: Topic, options: Options) -> Iterator[ForeignFrame]:
    """Yields the images of all parts; the numbers go on from part to part.

    Raises:
        RouteError: A part begins before the one before it.
    """
    (message_type,) = topic.types
    scale = options.scale()
    total = 0
    began = -math.inf
    for path in paths:
        messages = read_messages(path, topic.name, message_type, complete=True)
        for number, (recorded, message) in enumerate(messages):
            where = f"message {number} of {topic.name} in {readable(path)}"
            seconds = stamp_of(recorded, message, where, options.clock)
            if number == 0 and seconds < began:
                raise RouteError(
                    f"{readable(path)} begins before the part that it follows; name the parts in the order of time "
                    "with `join=FIRST,SECOND,...`"
                )
            began = seconds if number == 0 else began
            content = _encoded(message, where) if message_type == _COMPRESSED else _pixels(message, where, scale)
            yield ForeignFrame(f"{total:06d}", content, seconds=seconds, scale=scale)
            total += 1


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
