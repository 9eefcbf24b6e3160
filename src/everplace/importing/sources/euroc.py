"""EuRoC MAV sequences: `mav0/cam0/data.csv` with the images in `mav0/cam0/data/`, and the estimated truth.

The format is that of Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 35(10), 2016: lines
`timestamp [ns], file`, and in `mav0/state_groundtruth_estimate0/data.csv` the pose of the vehicle's body
(position, quaternion with w first) in a world whose z axis points up. `sensor.yaml` beside the images holds
T_BS, the camera's pose in the body's frame. The route's plane is the world's x and y.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath, by_stem
from everplace.importing.containers.text_rows import read_rows
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

SUMMARY = "EuRoC MAV: mav0/cam0 with time stamps and the estimated truth, one sequence or several"

# No two places of one pattern can match the same text, so that a damaged file is read through once.
_TRANSFORM = re.compile(r"^T_BS:", re.MULTILINE)
_DATA = re.compile(r"^[^\S\n]*data:\s*\[([^\[\]]*)\]", re.MULTILINE)

_LONGEST_YAML = 1 << 20


class Options(TimedSequenceOptions):
    """Options of the kind."""

    camera: str = "cam0"
    """Directory of the camera in mav0."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a sequence, its `mav0`, or the directory above several, unpacked or as archives; each is a traverse.

    Poses are interpolated between the two nearest in time. A stem is the image's file name, which is its time.

    Raises:
        RouteError: There is no sequence, or a file in it is missing or malformed.
    """
    found, notes = find_sequences(
        source,
        lambda path: (_mav0(path) / options.camera / "data.csv").is_file(),
        f"mav0/{options.camera}/data.csv",
        apart=True,
    )
    sequences = [_read_sequence(path, options) for path in found]
    return sequences_route(sequences, options.radius, f"no pose within {options.limit:g} s", notes)


def _mav0(path: TreePath) -> TreePath:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _read_sequence(directory: TreePath, options: Options) -> ImageSequence:
    root = _mav0(directory)
    name = root.parent.name if root.name == "mav0" else root.name
    camera, truth = root / options.camera, root / "state_groundtruth_estimate0" / "data.csv"
    listing = camera / "data.csv"
    times = {row.inside(1): row.whole(0, "a time stamp") for row in read_rows(listing, ",")}
    has_poses = options.poses and truth.is_file()
    poses: list[Pose | None] = [None] * len(times)
    if has_poses and times:
        # Nanoseconds since 1970 do not fit a float: the first image is moment 0.
        start = next(iter(times.values()))
        seconds = [(stamp - start) / 1e9 for stamp in times.values()]
        trajectory = read_trajectory(truth, lambda row: (row.whole(0, "a time stamp") - start) / 1e9, ",", w_first=True)
        poses = poses_at(trajectory, seconds, options.limit, "z", _read_camera(camera))
    stems = {file: stem for stem, file in by_stem(camera, times).items()}
    frames = [
        SequenceFrame(stems[file], file, stamp / 1e9, pose)
        for (file, stamp), pose in zip(times.items(), poses, strict=True)
    ]
    return ImageSequence(name, camera / "data", listing, frames, has_poses)


def _read_camera(camera: TreePath) -> NDArray[np.float64]:
    """Returns T_BS, 4×4."""
    path = camera / "sensor.yaml"
    if not path.is_file():
        raise RouteError(
            f"there is no {readable(path)}, which says how the camera is mounted; get the sequence again, or import "
            "with `poses=false`"
        )
    with path.open() as file:
        text = file.read(_LONGEST_YAML).decode("utf-8", "replace")
    start = _TRANSFORM.search(text)
    match = _DATA.search(text, start.end()) if start else None
    try:
        matrix = np.array([float(value) for value in match[1].split(",")]).reshape(4, 4) if match else None
    except ValueError:
        matrix = None
    if matrix is None or not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e6:
        raise RouteError(f"{readable(path)} holds no T_BS with 16 numbers; get the sequence again")
    return matrix
