"""A drive as a map takes it: a directory of images, a video or a bag, whose frames are read one by one."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from everplace.describe.recorded_frames import RecordedFrames, is_recording, is_video, open_recording
from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.video_frames import VIDEO_ENDINGS
from everplace.importing.foreign_route import NOT_KNOWN, ForeignFrame
from everplace.importing.recording import RecordingOptions
from everplace.importing.sources.bag import read_fixes
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
        origin: Latitude and longitude from which the metres of their poses count; empty: of no place on Earth.
    """

    name: str
    frames: Iterator[ForeignFrame]
    count: int | None = None
    origin: tuple[float, ...] = ()


def open_drive(
    source: Traverse | str | os.PathLike[str], *, fixes: bool = False, origin: tuple[float, ...] = ()
) -> DriveFrames:
    """Opens a drive.

    Args:
        source: A traverse, a directory of images, a video file, a ROS bag (a file, or a directory of ROS 2).
        fixes: Whether frames of a bag get the poses that its satellite receiver gives, where it had a fix. Other poses
            of a bag count from wherever its drive began, and so are none on a map.
        origin: Latitude and longitude from which the metres of these poses count; empty: the bag's first fix.

    Raises:
        RouteError: There is nothing, or no frame in it.
        MissingExtraError: Reading it needs an extra.
    """
    if isinstance(source, Traverse):
        return DriveFrames(source.name, _traverse_frames(source), len(source))
    path = Path(source)
    if is_recording(path):
        recording = open_recording(path)
        drive = DriveFrames(recording.drive.name, _recorded_frames(recording), recording.drive.count)
        return _with_fixes(drive, path, origin) if fixes and not is_video(path) else drive
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


def _with_fixes(drive: DriveFrames, bag: Path, origin: tuple[float, ...]) -> DriveFrames:
    try:
        found = read_fixes(bag, origin)
    except RouteError as error:
        warnings.warn(f"the drive gets no poses: {error}", stacklevel=3)
        return drive
    if found is None:
        return drive
    track, origin = found

    def placed() -> Iterator[ForeignFrame]:
        for frame in drive.frames:
            pose = None if frame.seconds is None else track.at(frame.seconds, RecordingOptions().pose_limit)
            yield frame if pose is None or pose is NOT_KNOWN else frame._replace(pose=pose)

    return replace(drive, frames=placed(), origin=origin)


def _traverse_frames(traverse: Traverse) -> Iterator[ForeignFrame]:
    return (ForeignFrame(frame.stem, frame.path, frame.pose) for frame in traverse)
