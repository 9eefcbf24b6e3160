"""TUM RGB-D sequences: `rgb.txt` names the images and their times, `groundtruth.txt` holds the camera's poses.

The format is that of Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems", IROS 2012: lines
`timestamp file` and `timestamp tx ty tz qx qy qz qw`, the pose of the colour camera's optical frame (x right,
y down, z ahead) in the motion capture's world, whose z axis points up. The route's plane is the world's x and y.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Annotated

from pydantic import Field

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath, by_stem
from everplace.importing.containers.text_rows import read_rows
from everplace.importing.foreign_route import ForeignRoute, SourceOptions
from everplace.importing.positions.trajectory import Trajectory, read_quaternion, rotation_of
from everplace.importing.sources._odometry_sequences import (
    ImageSequence,
    SequenceFrame,
    find_sequences,
    poses_at,
    sequences_route,
)
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "TUM RGB-D: rgb.txt with time stamps and groundtruth.txt with poses, one sequence or several"


class Options(SourceOptions):
    """Options of the kind.

    Attributes:
        images: The list of images, in a sequence's directory.
        poses: Whether to read groundtruth.txt where it is there; frames without a pose are then left out.
        limit: Seconds from an image to the nearest pose, up to which the pose counts.
        radius: Metres up to which two images show the same place; the data set names none.
    """

    images: str = "rgb.txt"
    poses: bool = True
    limit: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.02
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None


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
        moment, name = row.floats(0, 1)[0], row.inside(1)
        if name in seconds:
            raise row.wrong(f"names the image {name!r} a second time; keep one line for each image")
        seconds[name] = moment
    stems = {name: PurePosixPath(name).stem for name in seconds}
    if len(set(stems.values())) < len(stems):
        stems = {name: stem for stem, name in by_stem(directory, seconds).items()}
    has_poses = options.poses and truth.is_file()
    poses: list[Pose | None] = [None] * len(seconds)
    if has_poses and seconds:
        poses = poses_at(_read_trajectory(truth), list(seconds.values()), options.limit, "z")
    frames = [
        SequenceFrame(stems[name], name, moment, pose)
        for (name, moment), pose in zip(seconds.items(), poses, strict=True)
    ]
    return ImageSequence(directory.name, directory, listing, frames, has_poses)


def _read_trajectory(path: TreePath) -> Trajectory:
    seconds: list[float] = []
    positions: list[list[float]] = []
    quaternions: list[list[float]] = []
    for row in read_rows(path):
        seconds += row.floats(0, 1)
        positions.append(row.floats(1, 4))
        quaternions.append(read_quaternion(row, 4, w_first=False))
    if not seconds:
        raise RouteError(f"{readable(path)} holds no pose; get the sequence again, or import with --set poses=false")
    return Trajectory.of(seconds, positions, rotation_of(quaternions))
