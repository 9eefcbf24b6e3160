"""KITTI odometry: `sequences/NN/image_0/`, `sequences/NN/times.txt` and `poses/NN.txt`.

The format is that of Geiger et al., "Are we ready for Autonomous Driving? The KITTI Vision Benchmark Suite",
CVPR 2012: line k of a pose file holds the 3×4 pose, row by row, of the left grey camera at image k in the frame
of image 0, whose x axis points right, y down and z ahead. In the route's plane x is ahead at image 0 and y is
left of it. The other cameras, which are at most 0.6 m beside that one, get its poses.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_directories
from everplace.importing.containers.file_trees import TreePath, image_names
from everplace.importing.containers.text_rows import read_rows
from everplace.importing.foreign_route import ForeignRoute
from everplace.importing.positions.trajectory import plane_poses
from everplace.importing.sources._image_sequences import (
    ImageSequence,
    SequenceFrame,
    SequenceOptions,
    find_sequences,
    sequences_route,
)
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "KITTI odometry: sequences/NN with image_0 and times.txt, poses/NN.txt"

_NUMBER = re.compile(r"[0-9]{1,9}")


class Options(SequenceOptions):
    """Options of the kind."""

    camera: Literal["image_0", "image_1", "image_2", "image_3"] = "image_0"
    """Directory of the images."""
    sequences: tuple[str, ...] = ()
    """Which sequences, by name; all if none is given."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens the data set, its `sequences` directory, one sequence, or archives of them; each sequence is a traverse.

    Image and pose belong together by the number in the image's name. A stem is the sequence's name and the
    image's, `00-000042`: image 42 of another sequence is another place.

    Raises:
        RouteError: There is no such sequence, or a file in it is missing or malformed.
    """

    def holding(camera: str) -> Callable[[TreePath], bool]:
        return lambda path: (path / camera).is_dir()

    try:
        found, notes = find_sequences(source, holding(options.camera), f"{options.camera}/")
    except RouteError as error:
        for camera in get_args(Options.model_fields["camera"].annotation):  # the colour archive has image_2 and image_3
            if find_directories(source, holding(camera))[0]:
                raise RouteError(
                    f"neither {readable(source)} nor a directory in it holds {options.camera}/, but there is {camera}/"
                    f"; take it with `camera`={camera}"
                ) from error
        raise
    names = [path.name for path in found]
    for name in options.sequences:
        if name not in names:
            raise RouteError(
                f"{readable(source)} has no sequence {name!r}; there are: {', '.join(map(readable, names))}"
            )
    chosen = [path for path, name in zip(found, names, strict=True) if name in (options.sequences or names)]
    sequences = [_read_sequence(path, options) for path in chosen]
    return sequences_route(sequences, options.radius, "no line in the file of poses", notes)


def _read_sequence(directory: TreePath, options: Options) -> ImageSequence:
    name = directory.name
    images, times = directory / options.camera, directory / "times.txt"
    poses_file = directory.parent.parent / "poses" / f"{name}.txt"
    has_poses = options.poses and poses_file.is_file()
    poses = _read_poses(poses_file) if has_poses else []
    seconds = [row.floats(0, 1)[0] for row in read_rows(times)] if times.is_file() else []
    frames: list[SequenceFrame] = []
    for file in image_names(images):
        number = file.rpartition(".")[0]
        if not _NUMBER.fullmatch(number):
            raise RouteError(f"the name of {readable(images / file)} is not the number of an image; move it away")
        index = int(number)
        if seconds and index >= len(seconds):
            raise RouteError(f"{readable(times)} has {len(seconds)} lines, but there is the image {file}; get it again")
        frames.append(
            SequenceFrame(
                f"{name}-{number}",
                file,
                seconds[index] if seconds else None,
                poses[index] if index < len(poses) else None,
            )
        )
    if len({frame.stem for frame in frames}) < len(frames):
        raise RouteError(f"{readable(images)} holds two images of one number; keep one of them")
    return ImageSequence(name, images, images, frames, has_poses)


def _read_poses(path: TreePath) -> list[Pose]:
    from scipy.spatial.transform import Rotation

    rows = []
    for row in read_rows(path):
        matrix = np.array(row.floats(0, 12)).reshape(3, 4)
        turn = matrix[:, :3]
        if np.abs(turn).max() > 2 or not np.allclose(turn @ turn.T, np.eye(3), atol=0.05) or np.linalg.det(turn) < 0:
            raise row.wrong("holds no pose: the left 3×3 part of its 3×4 matrix does not turn; correct it")
        rows.append(matrix)
    if not rows:
        raise RouteError(f"{readable(path)} holds no pose; get it again, or import with `poses=false`")
    poses = np.stack(rows)
    return plane_poses(poses[:, :, 3], Rotation.from_matrix(poses[:, :, :3]), "-y")
