"""What a bag says about where its camera was: a track of positions or poses from one topic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.ros_bag import Topic, read_messages
from everplace.importing.positions.geodesy import local_plane, track_headings
from everplace.importing.positions.pose_track import BODY_AXIS, PoseTrack, planar_track
from everplace.importing.positions.trajectory import OPTICAL_AXIS, Trajectory, rotation_of

__all__ = ["FIX", "POSES", "Clock", "first_position", "read_track", "stamp_of"]

FIX = "sensor_msgs/msg/NavSatFix"
"""Positions by satellite."""

POSES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
)
"""Poses in metres."""

Clock = Literal["header", "recorded"]
"""Which times count: those of the messages, or those of recording."""


def stamp_of(recorded: int, message: Any, where: str, clock: Clock) -> float:
    """Returns when a message was sent, in seconds.

    Raises:
        RouteError: It has no time stamp.
    """
    seconds = _stamp(recorded, message, clock)
    if seconds is None:
        raise RouteError(f"{where} has no time stamp; take the times of recording with `clock=recorded`")
    return seconds


def first_position(paths: Sequence[Path], topic: Topic) -> tuple[float, float] | None:
    """Returns latitude and longitude of the first fix in the bags of a drive; None: there is none.

    Raises:
        RouteError: A bag is damaged.
    """
    for path in paths:
        for _, message in read_messages(path, topic.name, FIX):
            if _is_fixed(message):
                return float(message.latitude), float(message.longitude)
    return None


def read_track(
    paths: Sequence[Path],
    topic: Topic,
    label: str,
    clock: Clock,
    ahead: Literal["x", "z"],
    origin: tuple[float, ...],
) -> PoseTrack:
    """Reads all positions or poses of a topic, those of all bags of a drive as one track.

    Args:
        paths: The bags.
        topic: The topic, whose messages are of one type.
        label: What the drive is called in messages.
        clock: Which times count.
        ahead: The camera's axis in the frame of the body whose poses they are.
        origin: Latitude and longitude from which metres are counted; of no effect for poses.

    Raises:
        RouteError: There is no position, or a pose is not finite or has no direction.
    """
    (message_type,) = topic.types
    seconds: list[float] = []
    values: list[list[float]] = []
    unknown: list[float] = []
    for path in paths:
        for number, (recorded, message) in enumerate(read_messages(path, topic.name, message_type)):
            where = f"message {number} of {topic.name} in {readable(path)}"
            if message_type == FIX and not _is_fixed(message):
                lost = _stamp(recorded, message, clock)
                unknown += [] if lost is None else [lost]
                continue
            values.append([message.latitude, message.longitude] if message_type == FIX else _pose_of(message, where))
            seconds.append(stamp_of(recorded, message, where, clock))
    if not values:
        raise RouteError(f"the topic {topic.name} of {label} holds no position; choose another or none with `poses`")
    name = f"the topic {topic.name} of {label}"
    table = np.array(values, dtype=np.float64)
    if message_type == FIX:
        order = np.argsort(seconds, kind="stable")
        positions = local_plane(table[order], (origin[0], origin[1]))
        poses = np.column_stack([positions, track_headings(positions)])
        return planar_track(name, np.array(seconds)[order], poses, np.array(unknown))
    axis = BODY_AXIS if ahead == "x" else OPTICAL_AXIS
    return PoseTrack(name, Trajectory.of(seconds, table[:, :3].tolist(), rotation_of(table[:, 3:].tolist())), axis)


def _stamp(recorded: int, message: Any, clock: Clock) -> float | None:
    if clock == "recorded":
        return recorded * 1e-9
    stamp = message.header.stamp
    return None if stamp.sec == 0 and stamp.nanosec == 0 else float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _is_fixed(message: Any) -> bool:
    """Says whether a receiver knew where it was (status -1: it did not; nor at exactly 0, 0, whatever the status)."""
    latitude, longitude = message.latitude, message.longitude
    return bool(
        message.status.status >= 0 and abs(latitude) <= 90 and abs(longitude) <= 180 and (latitude or longitude)
    )


def _pose_of(message: Any, where: str) -> list[float]:
    """Returns the position and the quaternion x, y, z, w."""
    pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
    position, q = pose.position, pose.orientation
    values = [float(value) for value in (position.x, position.y, position.z, q.x, q.y, q.z, q.w)]
    if not all(map(math.isfinite, values)) or not 0.95 < math.hypot(*values[3:]) < 1.05:
        raise RouteError(
            f"{where} has a position that is not finite or a quaternion whose length is not 1; choose another topic "
            "or none with `poses`"
        )
    return values
