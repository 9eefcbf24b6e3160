"""Gives the frames of a recording the poses that were recorded beside them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.foreign_route import NOT_KNOWN, ForeignFrame
from everplace.importing.positions.trajectory import Trajectory, plane_poses
from everplace.importing.recording import RecordingOptions
from everplace.route.csv_table import CsvTable
from everplace.route.natural_order import natural_sorted
from everplace.route.traverse import Pose

__all__ = [
    "BODY_AXIS",
    "PoseTrack",
    "named_by_poses",
    "planar_track",
    "read_named_poses",
    "read_pose_track",
    "with_poses",
]

BODY_AXIS = (1.0, 0.0, 0.0)
"""Where a vehicle looks in its own frame (REP 103): x ahead, y to the left, z up."""

_PLANE = ("x", "y", "heading")


@dataclass(frozen=True)
class PoseTrack:
    """Poses over time.

    Attributes:
        origin: Where they come from, for messages.
        trajectory: The poses; the world's z points up.
        axis: Where the camera looks, in the frame of the body whose poses they are.
        unknown: Moments at which the recording says that it does not know the pose, in seconds.
    """

    origin: str
    trajectory: Trajectory
    axis: tuple[float, float, float] = BODY_AXIS
    unknown: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def at(self, seconds: float, limit: float) -> Pose | None:
        """Returns the pose at a moment, as far as `limit` seconds from one that is known.

        Without one it is `NOT_KNOWN` where the recording says within `limit` seconds that it does not know, else None.
        """
        positions, rotations, known = self.trajectory.at(np.array([seconds]), limit)
        if known[0]:
            return plane_poses(positions, rotations, "z", self.axis)[0]
        return NOT_KNOWN if (np.abs(self.unknown - seconds) <= limit).any() else None


def planar_track(
    origin: str, seconds: NDArray[np.float64], poses: NDArray[np.float64], unknown: NDArray[np.float64] | None = None
) -> PoseTrack:
    """Makes a track of N times and N×3 poses x, y, heading; N is at least 1. `unknown`: see `PoseTrack`."""
    from scipy.spatial.transform import Rotation

    positions = np.column_stack([poses[:, :2], np.zeros(len(poses))])
    turns = Rotation.from_euler("z", poses[:, 2:])
    trajectory = Trajectory.of(seconds.tolist(), positions.tolist(), turns)
    return PoseTrack(origin, trajectory, unknown=np.zeros(0) if unknown is None else unknown)


def with_poses(
    frames: Iterator[ForeignFrame], track: PoseTrack | None, options: RecordingOptions, drive: str
) -> Iterator[ForeignFrame]:
    """Adds the pose at each frame's time, interpolated between the two around it; it may be `NOT_KNOWN`.

    Args:
        frames: Frames with times.
        track: The poses; None: there are none.
        options: How far a pose may be, and what to do without one.
        drive: The name of the drive, for messages.

    Raises:
        RouteError: A frame has no time, or no pose near it and may not be dropped.
    """
    for frame in frames:
        if track is None:
            yield frame
            continue
        if frame.seconds is None:
            raise RouteError(
                f"the frame {frame.stem!r} of {readable(drive)} has no time, so no pose of {track.origin} can be found "
                "for it; name the poses by stem instead"
            )
        pose = track.at(frame.seconds, options.pose_limit)
        if pose is not None and (pose is not NOT_KNOWN or options.without_pose == "refuse"):
            yield frame._replace(pose=pose)
        elif options.without_pose == "refuse":
            raise RouteError(
                f"{track.origin} has no pose within {options.pose_limit:g} s of the frame {frame.stem!r} of "
                f"{readable(drive)}, at {frame.seconds:.3f} s; leave such frames out with `without_pose=drop`, or "
                "allow more with `pose_limit`"
            )


def read_pose_track(path: Path) -> PoseTrack:
    """Reads poses over time: the columns seconds, x, y (metres), heading (radians).

    Raises:
        RouteError: The file cannot be read, lacks a column, holds a number that is not finite, or no row at all.
    """
    columns = ("seconds", *_PLANE)
    rows = [row.floats(columns, "four numbers") for row in CsvTable(path, columns)]
    if not rows:
        raise RouteError(f"{readable(path)} holds no pose; add rows or remove the file")
    table = np.array(rows, dtype=np.float64)
    return planar_track(readable(path), table[:, 0], table[:, 1:])


def read_named_poses(path: Path) -> dict[str, Pose]:
    """Reads one pose for each frame: the columns stem, x, y (metres), heading (radians).

    Returns:
        The poses by stem, in the order of the file.

    Raises:
        RouteError: The file cannot be read, lacks a column, holds a number that is not finite or a stem twice, or
            no row at all, or its stems are not in natural order.
    """
    named: dict[str, Pose] = {}
    for row in CsvTable(path, ("stem", *_PLANE)):
        stem = row.cells["stem"]
        if stem in named:
            raise row.wrong(f"names the stem {stem!r} a second time; keep one pose for each frame")
        named[stem] = Pose(*row.floats(_PLANE, "a stem and three numbers"))
    if not named:
        raise RouteError(f"{readable(path)} holds no pose; add rows or remove the file")
    if natural_sorted(named) != list(named):
        raise RouteError(
            f"the stems in {readable(path)} are not in natural order, in which a route puts its frames; number them in "
            "the order of the frames"
        )
    return named


def named_by_poses(frames: Iterator[ForeignFrame], poses: dict[str, Pose], path: Path) -> Iterator[ForeignFrame]:
    """Gives the i-th frame the stem and the pose of the i-th row of a pose file.

    Raises:
        RouteError: There are more or fewer frames than rows.
    """
    rows = iter(poses.items())
    count = 0
    for frame in frames:
        stem, pose = next(rows, (None, None))
        if stem is None:
            raise RouteError(
                f"{readable(path)} has {len(poses)} rows, but there are more frames; give a row for each frame, or a "
                "column seconds instead of stem"
            )
        yield frame._replace(stem=stem, pose=pose)
        count += 1
    if count < len(poses):
        raise RouteError(
            f"{readable(path)} has {len(poses)} rows, but there are only {count} frames; give a row for each frame, "
            "or a column seconds instead of stem"
        )
