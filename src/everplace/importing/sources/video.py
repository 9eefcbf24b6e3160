"""Video files, one drive each, with poses from a CSV file beside them.

`winter.mp4` becomes the traverse `winter`. The poses of its frames may stand in `winter.poses.csv`, with the columns
x, y (metres), heading (radians) and one of

| column | meaning |
|---|---|
| `stem` | one row for each frame, in order; the frames are called so |
| `seconds` | times from the first frame on, at any rate; poses are interpolated |
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Literal

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.containers.video_frames import ANEW, VIDEO_ENDINGS, check_video, read_video
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute
from everplace.importing.positions.pose_track import named_by_poses, read_named_poses, read_pose_track, with_poses
from everplace.importing.recording import Drive, RecordingOptions, passed_over, recorded_route
from everplace.route.csv_table import CsvTable

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


class Options(RecordingOptions):
    """Options of the kind."""

    damaged: Literal["refuse", "keep"] = "refuse"
    """What to do with a video that breaks off: refuse it, or keep the frames before the break (it is then decoded
    twice, once to find the break)."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens one or several videos.

    Raises:
        RouteError: There is no video, one is empty or no video, or a pose file is wrong.
        ConfigError: There are not as many conditions as videos.
        MissingExtraError: PyAV is not installed.
    """
    paths = [source]
    notes: list[str] = []
    if source.is_dir():
        files = TreePath(source).children().files
        paths = [source / name for name in files if name.lower().endswith(tuple(VIDEO_ENDINGS))]
        notes += passed_over(source, files, "videos", _OTHER_ENDINGS)
    if not paths:
        raise RouteError(
            f"{readable(source)} holds no video ({', '.join(sorted(VIDEO_ENDINGS))}); give a video or a directory of "
            "videos"
        )
    drives = [_open(path, options, notes) for path in paths]
    return recorded_route(source, drives, options, notes)


def _open(path: Path, options: Options, notes: list[str]) -> Drive:
    count, doubt = check_video(path)
    sidecar = path.with_suffix(".poses.csv")
    timed = sidecar.exists() and "seconds" in CsvTable(sidecar).columns
    track = read_pose_track(sidecar) if timed else None
    named = read_named_poses(sidecar) if sidecar.exists() and not timed else None
    kept: int | None = None
    if options.damaged == "keep":
        kept, problem = _readable_frames(path)
        if problem is not None:
            notes.append(f"Only the first {kept} frames of {readable(path)} were kept: {problem}.")
            count, doubt = kept, ""
    if doubt:
        notes.append(doubt)
    frames = _frames(path, kept)
    if named is not None:
        # A video that broke off has fewer frames than poses.
        rows = named if kept is None else dict(islice(named.items(), kept))
        return Drive(path.stem, named_by_poses(frames, rows, sidecar), count, named=True)
    if track is not None and options.without_pose == "drop":
        count = None
    return Drive(path.stem, with_poses(frames, track, options, path.name), count)


def _frames(path: Path, count: int | None) -> Iterator[ForeignFrame]:
    """Yields the frames of a video, or the first `count` of them, called by their numbers."""
    for number, frame in enumerate(islice(read_video(path, broken=_BROKEN), count)):
        yield ForeignFrame(f"{number:06d}", frame.pixels, seconds=frame.seconds)


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
