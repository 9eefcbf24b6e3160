"""A drive as a map takes it: a directory of images, a video or a bag, whose frames are read one by one."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from everplace.describe.recorded_frames import RecordedFrames, is_recording, open_recording
from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.video_frames import VIDEO_ENDINGS
from everplace.importing.foreign_route import ForeignFrame
from everplace.route.csv_table import read_poses
from everplace.route.folder import POSES_CSV, open_traverse
from everplace.route.traverse import Traverse

__all__ = ["DriveFrames", "open_drive"]


@dataclass(frozen=True, eq=False)
class DriveFrames:
    """The frames of one drive, read once.

    Attributes:
        name: What the drive is called unless the user says otherwise.
        frames: In order; stems are file stems, of a video or a bag the frames' numbers.
        count: How many will come, if known.
    """

    name: str
    frames: Iterator[ForeignFrame]
    count: int | None = None


def open_drive(source: Traverse | str | os.PathLike[str]) -> DriveFrames:
    """Opens a drive.

    Args:
        source: A traverse, a directory of images, a video file, a ROS bag (a file, or a directory of ROS 2).

    Raises:
        RouteError: There is nothing, or no frame in it.
        MissingExtraError: Reading it needs an extra.
    """
    if isinstance(source, Traverse):
        return DriveFrames(source.name, _traverse_frames(source), len(source))
    path = Path(source)
    if is_recording(path):
        recording = open_recording(path)
        return DriveFrames(recording.drive.name, _recorded_frames(recording), recording.drive.count)
    if path.is_file():
        raise RouteError(
            f"{readable(path)} is no directory of images, no video ({', '.join(sorted(VIDEO_ENDINGS))}) and no bag; "
            "give one of these"
        )
    traverse = open_traverse(path)
    poses = path / POSES_CSV
    if poses.is_file():
        traverse = replace(traverse, poses=read_poses(poses, traverse.stems))
    return DriveFrames(traverse.name, _traverse_frames(traverse), len(traverse))


def _recorded_frames(recording: RecordedFrames) -> Iterator[ForeignFrame]:
    """Yields the frames, and in the end warns of what the recording has to tell."""
    yield from recording.frames()
    for note in recording.notes:
        warnings.warn(note, stacklevel=2)


def _traverse_frames(traverse: Traverse) -> Iterator[ForeignFrame]:
    return (ForeignFrame(frame.stem, frame.path, frame.pose) for frame in traverse)
