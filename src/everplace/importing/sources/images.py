"""Directories of images, one for each drive, whose names say nothing about places.

Images that a camera wrote are in natural order of their names (`9 < 10`). A directory may hold `times.csv` (columns
stem, seconds) and `poses.csv` (columns x, y in metres, heading in radians, and stem or seconds).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.decoding import is_image_name
from everplace.images.frame_names import unread_pictures
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute
from everplace.importing.positions.pose_track import PoseTrack, read_pose_track, with_poses
from everplace.importing.recording import Drive, RecordingOptions, recorded_route
from everplace.route.csv_table import CsvTable, read_poses, read_times
from everplace.route.folder import POSES_CSV, TIMES_CSV, open_traverse
from everplace.route.route_toml import RouteToml, read_route_toml
from everplace.route.traverse import Pose, Traverse

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "a directory of images, or a directory of such directories, one for each drive"

Options = RecordingOptions


def read(source: Path, options: RecordingOptions) -> ForeignRoute:
    """Opens one or several directories of images.

    Raises:
        RouteError: There is no image, two images share a stem, or times or poses are wrong or missing for some.
        ConfigError: There are not as many conditions as directories, or a route.toml that is there is wrong.
    """
    if not source.is_dir():
        raise RouteError(f"{readable(source)} is not a directory; give a directory of images")
    directories, files = TreePath(source).children()
    if any(map(is_image_name, files)):
        # A name of its own even where the source is given as `.`
        return recorded_route(source, [_open(source.absolute(), options)], options, _left_out(directories))
    holding = [name for name in directories if any(map(is_image_name, TreePath(source / name).children().files))]
    if not holding:
        inside = (name for directory in directories for name in TreePath(source / directory).children().files)
        unread = unread_pictures([*files, *inside])
        raise RouteError(
            f"{readable(source)} holds no image, nor do its directories{unread}; give a directory of images"
        )
    others = [name for name in directories if name not in holding]
    drives = [_open(source / name, options) for name in holding]
    return recorded_route(source, drives, options, _left_out(others), told=_told(source, options))


def _told(source: Path, options: RecordingOptions) -> RouteToml:
    """Reads what a route says of itself; where its frames get new names, one that is wrong is of no consequence."""
    try:
        return read_route_toml(source)
    except ConfigError:
        if options.stems == "file":
            raise
        return RouteToml()


def _left_out(directories: Sequence[str]) -> tuple[str, ...]:
    if not directories:
        return ()
    return (f"Directories that were not read: {', '.join(map(readable, directories))}.",)


def _open(directory: Path, options: RecordingOptions) -> Drive:
    traverse = open_traverse(directory)
    poses = directory / POSES_CSV
    track: PoseTrack | None = None
    named: NDArray[np.float64] | None = None
    if poses.exists():
        if "seconds" in CsvTable(poses).columns:
            track = read_pose_track(poses)
        else:
            named = read_poses(poses, traverse.stems)
    frames = with_poses(_frames(traverse, _times(traverse), named), track, options, traverse.name)
    count = None if track is not None and options.without_pose == "drop" else len(traverse)
    return Drive(traverse.name, frames, count)


def _times(traverse: Traverse) -> NDArray[np.float64] | None:
    """Returns the time of each frame, if there is a table of them."""
    path = traverse.root / TIMES_CSV
    return read_times(path, traverse.stems) if path.exists() else None


def _frames(
    traverse: Traverse, times: NDArray[np.float64] | None, poses: NDArray[np.float64] | None
) -> Iterator[ForeignFrame]:
    for number, (stem, path) in enumerate(zip(traverse.stems, traverse.paths, strict=True)):
        pose = None if poses is None else Pose(*poses[number].tolist())
        yield ForeignFrame(stem, path, pose, None if times is None else float(times[number]))
