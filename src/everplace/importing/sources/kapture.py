"""kapture: `sensors/sensors.txt`, `records_camera.txt`, `trajectories.txt` and `rigs.txt`.

The format is kapture 1.1 (Humenberger et al., "Robust Image Retrieval-based Visual Localization using Kapture",
2020): comma-separated values; a pose is the rotation (quaternion, w first) and translation from the world to the
camera or to the rig that carries it. The images lie in `sensors/records_data/`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath, by_stem
from everplace.importing.containers.text_rows import TextRow, read_rows
from everplace.importing.foreign_route import ForeignRoute
from everplace.importing.positions.trajectory import Up, plane_poses, read_quaternion, rotation_of
from everplace.importing.sources._image_sequences import (
    ImageSequence,
    SequenceFrame,
    SequenceOptions,
    find_sequences,
    sequences_route,
)

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "kapture: sensors/records_camera.txt with the poses of trajectories.txt, one directory or several"

_RECORDS = "records_camera.txt"
_DEEPEST_RIG = 10


class Options(SequenceOptions):
    """Options of the kind."""

    camera: str = ""
    """Identifier of the camera; all: every one. Needed where several cameras took images."""
    by_folder: bool = False
    """One traverse for each first directory of the images' paths (mapping, query), and not for each kapture
    directory."""
    up: Up = "z"
    """The world's axis that points up: kapture does not say which it is. -y where the world is the frame of the first
    camera."""


class _Transform(NamedTuple):
    """Takes a point x of one frame to `turn` x + `shift` in another: 3×3 and 3."""

    turn: NDArray[np.float64]
    shift: NDArray[np.float64]


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a kapture directory, or the directory above several (`mapping`, `query`), unpacked or as archives.

    A stem is the image's path with `-` for `/`. The pose is that of the camera's centre, laid onto the plane
    that is perpendicular to `up`.

    Raises:
        RouteError: There is no such directory, a file in it is missing or malformed, or several cameras took
            images and none was chosen.
    """
    found, notes = find_sequences(source, lambda path: (path / "sensors" / _RECORDS).is_file(), f"sensors/{_RECORDS}")
    sequences = [sequence for path in found for sequence in _read_directory(path, options)]
    if any(sequence.has_poses for sequence in sequences):
        notes.append(f"The axis {options.up} was taken for up; if it is another, say so with `up=AXIS`.")
    return sequences_route(sequences, options.radius, "no pose in trajectories.txt", notes)


def _read_directory(directory: TreePath, options: Options) -> list[ImageSequence]:
    sensors = directory / "sensors"
    records = _read_records(sensors, options.camera)
    has_poses = options.poses and (sensors / "trajectories.txt").is_file()
    centres: Mapping[tuple[int, str], _Transform] = {}
    rigs: Mapping[str, list[tuple[str, _Transform]]] = {}
    if has_poses:
        centres = {
            (row.whole(0, "a time stamp"), row.text(1)): _transform(row)
            for row in read_rows(sensors / "trajectories.txt", ",")
            if len(row) < 9 or all(row.fields[2:9])  # the format lets unknown values be empty
        }
        rigs = _read_rigs(sensors / "rigs.txt")
    poses = {name: _camera_from_world(when, camera, centres, rigs) for name, (when, camera) in records.items()}
    placed = [name for name, pose in poses.items() if pose is not None]
    plane = {}
    if placed:
        turns = np.stack([pose.turn for pose in poses.values() if pose is not None])
        shifts = np.stack([pose.shift for pose in poses.values() if pose is not None])
        back = rotation_of([[0.0, 0.0, 0.0, 1.0]]).from_matrix(turns).inv()
        plane = dict(zip(placed, plane_poses(-back.apply(shifts), back, options.up), strict=True))
    listing, images = sensors / _RECORDS, sensors / "records_data"
    stems = by_stem(images, records)
    groups: dict[str, list[SequenceFrame]] = {}
    whole = directory.name
    for stem, name in stems.items():
        folder = name.partition("/")[0] if options.by_folder and "/" in name else whole
        groups.setdefault(folder, []).append(SequenceFrame(stem, name, None, plane.get(name)))
    # A group without any pose (queries, whose poses are a secret of the benchmark) stays, and has none.
    return [
        ImageSequence(
            group, images, listing, frames, has_poses and (len(groups) == 1 or any(frame.pose for frame in frames))
        )
        for group, frames in groups.items()
    ]


def _read_records(sensors: TreePath, camera: str) -> dict[str, tuple[int, str]]:
    """Returns time stamp and camera by the image's name, of the chosen cameras."""
    path = sensors / _RECORDS
    cameras = {row.text(0) for row in read_rows(sensors / "sensors.txt", ",") if row.text(2) == "camera"}
    records: dict[str, tuple[int, str]] = {}
    for row in read_rows(path, ","):
        device = row.text(1)
        if device not in cameras:
            raise row.wrong(f"names the camera {device!r}, which sensors.txt does not; correct it")
        records[row.inside(2)] = row.whole(0, "a time stamp"), device
    if not records:
        raise RouteError(f"{readable(path)} names no image; get the data set again")
    used = sorted({device for _, device in records.values()})
    offer = ", ".join(map(readable, used)) or "none"
    if not camera and len(used) > 1:
        raise RouteError(f"{readable(path)} holds images of the cameras {offer}; choose one with `camera=ID`, or all")
    if camera and camera != "all" and camera not in used:
        raise RouteError(f"{readable(path)} holds no image of the camera {camera!r}, only of {offer}")
    return {name: record for name, record in records.items() if camera in {"", "all", record[1]}}


def _read_rigs(path: TreePath) -> dict[str, list[tuple[str, _Transform]]]:
    """Returns for each sensor the rigs that carry it, and what takes a point from the rig to the sensor."""
    rigs: dict[str, list[tuple[str, _Transform]]] = {}
    if path.is_file():
        for row in read_rows(path, ","):
            rigs.setdefault(row.text(1), []).append((row.text(0), _transform(row)))
    return rigs


def _transform(row: TextRow) -> _Transform:
    turn = rotation_of([read_quaternion(row, 2, w_first=True)]).as_matrix()[0]
    return _Transform(turn, np.array(row.floats(6, 9)))


def _camera_from_world(
    when: int,
    device: str,
    poses: Mapping[tuple[int, str], _Transform],
    rigs: Mapping[str, list[tuple[str, _Transform]]],
    depth: int = 0,
) -> _Transform | None:
    """Returns what takes a point of the world to a device's frame, over the rigs that carry it."""
    own = poses.get((when, device))
    if own is not None or depth > _DEEPEST_RIG:
        return own
    for rig, mounted in rigs.get(device, ()):
        carrier = _camera_from_world(when, rig, poses, rigs, depth + 1)
        if carrier is not None:
            return _Transform(mounted.turn @ carrier.turn, mounted.turn @ carrier.shift + mounted.shift)
    return None
