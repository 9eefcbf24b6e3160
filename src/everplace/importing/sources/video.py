"""Video files, one drive each, with poses from a CSV file beside them.

`winter.mp4` becomes the traverse `winter`. The poses of its frames may stand in `winter.poses.csv`, with the columns
x, y (metres), heading (radians) and one of

| column | meaning |
|---|---|
| `stem` | one row for each frame, in order; the frames are called so |
| `seconds` | times from the first frame on, at any rate; poses are interpolated |

Of a drive that is joined of several files, each may have its poses beside it, or all of them theirs beside the
directory: `winter.poses.csv` beside `winter/`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal, NamedTuple

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.containers.video_frames import ANEW, VIDEO_ENDINGS, check_video, read_video
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute
from everplace.importing.positions.pose_track import (
    PoseTrack,
    named_by_poses,
    read_named_poses,
    read_pose_track,
    with_poses,
)
from everplace.importing.recording import Drive, passed_over, recorded_route
from everplace.importing.recording_parts import PartOptions, Recording, find_recordings
from everplace.route.csv_table import CsvTable
from everplace.route.traverse import Pose

__all__ = ["EXTRAS", "SUMMARY", "Options", "read"]

SUMMARY = "a video file, or a directory of video files, one for each drive"

EXTRAS = {"av": "video"}
"""Which extra brings the package that reads it."""


_OTHER_ENDINGS = (
    *(
        ".264",
        ".265",
        ".360",
        ".3g2",
        ".3gp",
        ".asf",
        ".dav",
        ".f4v",
        ".flv",
        ".h264",
        ".h265",
        ".hevc",
        ".insv",
        ".ivf",
    ),
    *(".lrv", ".mjpeg", ".mjpg", ".mod", ".mpe", ".mxf", ".ogv", ".rmvb", ".tod", ".vob", ".y4m"),
    *(ending + rest for ending in sorted(VIDEO_ENDINGS) for rest in (".part", ".crdownload", ".tmp")),
)
"""Endings of videos that a directory's are not taken by: other forms, previews of cameras, broken downloads."""

_BROKEN = f"{ANEW}, or take the frames before that with `damaged=keep`"


class Options(PartOptions):
    """Options of the kind."""

    damaged: Literal["refuse", "keep"] = "refuse"
    """What to do with a video that breaks off: refuse it, or keep the frames before the break (it is then decoded
    twice, once to find the break)."""


class _Poses(NamedTuple):
    """What a file of poses holds: poses by time, or by name for each frame."""

    path: Path
    track: PoseTrack | None
    named: dict[str, Pose] | None


@dataclass(frozen=True)
class _Part:
    """One file.

    Attributes:
        path: The file.
        kept: How many of its frames are read; None: all.
        count: How many will come, if it is known.
        least: How many seconds it is long at least, though the frames of its end are missing.
        poses: What lies beside it.
    """

    path: Path
    kept: int | None
    count: int | None
    least: float
    poses: _Poses | None


@dataclass
class _Length:
    """How much of a part was read: frames, and seconds to the end of the last one; None: it has no times."""

    frames: int = 0
    seconds: float | None = 0.0


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens one or several videos.

    Raises:
        RouteError: There is no video, one is empty or no video, or a pose file is wrong.
        ConfigError: There are not as many conditions as videos, or a file that is to be joined is not there.
        MissingExtraError: PyAV is not installed.
    """
    recordings, notes = find_recordings(source, options.join, _videos)
    if not recordings:
        raise RouteError(
            f"{readable(source)} holds no video ({', '.join(sorted(VIDEO_ENDINGS))}); give a video or a directory of "
            "videos"
        )
    directories = dict.fromkeys(path.parent for one in recordings for path in one.parts) if source.is_dir() else ()
    for directory in directories:
        notes += passed_over(directory, TreePath(directory).children().files, "videos", _OTHER_ENDINGS)
    drives = [_open(recording, options, notes) for recording in recordings]
    return recorded_route(source, drives, options, notes)


def _videos(directory: Path) -> list[str]:
    return [name for name in TreePath(directory).children().files if name.lower().endswith(tuple(VIDEO_ENDINGS))]


def _open(recording: Recording, options: Options, notes: list[str]) -> Drive:
    parts = [_open_part(path, options, notes) for path in recording.parts]
    counts = [part.count for part in parts if part.count is not None]
    count = sum(counts) if len(counts) == len(parts) else None
    frames = _frames(parts, options)
    poses = parts[0].poses
    if len(parts) > 1:
        whole = _read_poses(parts[0].path.absolute().parent.parent / f"{recording.name}.poses.csv")
        _check_poses(parts, whole)
        if whole is not None:
            poses = whole
            frames = _posed(frames, whole, options, recording.name)
    if poses is not None and poses.track is not None and options.without_pose == "drop":
        count = None
    return Drive(recording.name, frames, count, named=poses is not None and poses.named is not None)


def _open_part(path: Path, options: Options, notes: list[str]) -> _Part:
    count, seconds, doubt = check_video(path)
    poses = _read_poses(path.with_suffix(".poses.csv"))
    kept: int | None = None
    least = 0.0
    if options.damaged == "keep":
        kept, problem = _readable_frames(path)
        if problem is not None:
            notes.append(f"Only the first {kept} frames of {readable(path)} were kept: {problem}.")
            count, least, doubt = kept, seconds or 0.0, ""
    if doubt:
        notes.append(doubt)
    return _Part(path, kept, count, least, poses)


def _read_poses(path: Path) -> _Poses | None:
    if not path.exists():
        return None
    if "seconds" in CsvTable(path).columns:
        return _Poses(path, read_pose_track(path), None)
    return _Poses(path, None, read_named_poses(path))


def _check_poses(parts: Sequence[_Part], whole: _Poses | None) -> None:
    """Raises `RouteError` for a drive of several files some of which have other poses than the rest."""
    beside = [part for part in parts if part.poses is not None]
    if whole is not None and beside:
        raise RouteError(
            f"{readable(whole.path)} holds poses of all parts of the drive, and {readable(beside[0].path)} has some of "
            "its own beside it; keep one of them"
        )
    if len({None if part.poses is None else part.poses.named is None for part in parts}) > 1:
        raise RouteError(
            f"the parts of the drive in {readable(parts[0].path.parent)} differ in their poses: by stem, by seconds or "
            "none; give all of them the same"
        )


def _frames(parts: Sequence[_Part], options: Options) -> Iterator[ForeignFrame]:
    """Yields the frames of a drive with the poses beside its files; numbers and times go on from file to file."""
    number = 0
    shift: float | None = 0.0
    for part in parts:
        length = _Length()
        named = part.poses is not None and part.poses.named is not None
        for frame in _posed(_frames_of(part, length), part.poses, options, part.path.name, part.kept):
            seconds = None if shift is None or frame.seconds is None else shift + frame.seconds
            stem = frame.stem if named else f"{number + int(frame.stem):06d}"
            yield frame._replace(stem=stem, seconds=seconds)
        number += length.frames
        shift = None if shift is None or length.seconds is None else shift + max(length.seconds, part.least)


def _frames_of(part: _Part, length: _Length) -> Iterator[ForeignFrame]:
    """Yields the frames of one file, called by their numbers, and counts them."""
    for number, frame in enumerate(islice(read_video(part.path, broken=_BROKEN), part.kept)):
        length.frames = number + 1
        length.seconds = None if frame.seconds is None else frame.seconds + frame.lasts
        yield ForeignFrame(f"{number:06d}", frame.pixels, seconds=frame.seconds)


def _posed(
    frames: Iterator[ForeignFrame], poses: _Poses | None, options: Options, drive: str, kept: int | None = None
) -> Iterator[ForeignFrame]:
    """Adds the poses of a file to the frames; `kept` is how many there are, if some are missing at the end."""
    if poses is None or poses.named is None:
        return with_poses(frames, None if poses is None else poses.track, options, drive)
    # A video that broke off has fewer frames than poses.
    rows = poses.named if kept is None else dict(islice(poses.named.items(), kept))
    return named_by_poses(frames, rows, poses.path)


def _readable_frames(path: Path) -> tuple[int, str | None]:
    """Counts the frames before the break, and says what the break is.

    Raises:
        RouteError: There are none.
    """
    count = 0
    try:
        for _ in read_video(path):
            count += 1
    except RouteError as error:
        if not count:
            raise
        return count, str(error).partition(";")[0]
    return count, None
