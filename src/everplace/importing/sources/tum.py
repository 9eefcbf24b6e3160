"""TUM RGB-D sequences: `rgb.txt` names the images and their times, `groundtruth.txt` holds the camera's poses.

The format is that of Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", IROS 2012: lines
`timestamp file` and `timestamp tx ty tz qx qy qz qw`, the pose of the colour camera's optical frame (x right,
y down, z ahead) in the motion capture's world, whose z axis points up. The route's plane is the world's x and y.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from everplace.importing.containers.file_trees import TreePath, by_stem
from everplace.importing.containers.text_rows import TextRow, read_rows
from everplace.importing.foreign_route import ForeignRoute
from everplace.importing.sources._image_sequences import (
    ImageSequence,
    SequenceFrame,
    TimedSequenceOptions,
    find_sequences,
    poses_at,
    read_trajectory,
    sequences_route,
)
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "TUM RGB-D: rgb.txt with time stamps and groundtruth.txt with poses, one sequence or several"


class Options(TimedSequenceOptions):
    """Options of the kind."""

    images: str = "rgb.txt"
    """The list of images, in a sequence's directory."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a sequence, or the directory above several, unpacked or as archives; each is a traverse.

    Poses are interpolated between the two nearest in time. A stem is the image's file name, which is its time.

    Raises:
        RouteError: There is no sequence, or a file in it is missing or malformed.
    """
    found, notes = find_sequences(source, lambda path: (path / options.images).is_file(), options.images, apart=True)
    sequences = [_read_sequence(path, options) for path in found]
    return sequences_route(sequences, options.radius, f"no pose within {options.limit:g} s", notes)


def _read_sequence(directory: TreePath, options: Options) -> ImageSequence:
    listing, truth = directory / options.images, directory / "groundtruth.txt"
    seconds: dict[str, float] = {}
    for row in read_rows(listing):
        moment, name = _seconds(row), row.inside(1)
        if name in seconds:
            raise row.wrong(f"names the image {name!r} a second time; keep one line for each image")
        seconds[name] = moment
    stems = {name: PurePosixPath(name).stem for name in seconds}
    if len(set(stems.values())) < len(stems):
        stems = {name: stem for stem, name in by_stem(directory, seconds).items()}
    has_poses = options.poses and truth.is_file()
    poses: list[Pose | None] = [None] * len(seconds)
    if has_poses and seconds:
        poses = poses_at(read_trajectory(truth, _seconds, w_first=False), list(seconds.values()), options.limit, "z")
    frames = [
        SequenceFrame(stems[name], name, moment, pose)
        for (name, moment), pose in zip(seconds.items(), poses, strict=True)
    ]
    return ImageSequence(directory.name, directory, listing, frames, has_poses)


def _seconds(row: TextRow) -> float:
    return row.floats(0, 1)[0]
