"""What the data sets of visual odometry share: sequences of images, some of which have a pose."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import FoundDirectories, find_directories
from everplace.importing.containers.file_trees import TreePath, read_files
from everplace.importing.containers.text_rows import TextRow, read_rows
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse, ScaledOptions
from everplace.importing.positions.trajectory import Trajectory, Up, plane_poses, read_quaternion, rotation_of
from everplace.route.natural_order import natural_sorted
from everplace.route.traverse import Pose

__all__ = [
    "ImageSequence",
    "SequenceFrame",
    "SequenceOptions",
    "TimedSequenceOptions",
    "find_sequences",
    "poses_at",
    "read_trajectory",
    "sequences_route",
]


class SequenceOptions(ScaledOptions):
    """Options of all these data sets."""

    poses: bool = True
    """Whether to read poses where they are there; frames without a pose are then left out."""
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Metres up to which two images show the same place; the data set names none."""


class TimedSequenceOptions(SequenceOptions):
    """Options where poses are found by time."""

    limit: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.02
    """Seconds from an image to the nearest pose, up to which the pose counts."""


class SequenceFrame(NamedTuple):
    """One image of a sequence.

    Attributes:
        stem: Its stem in the route.
        name: Its file, from the directory of the sequence's images.
        seconds: When it was taken, if that is known.
        pose: Where it was taken, if that is known.
    """

    stem: str
    name: str
    seconds: float | None = None
    pose: Pose | None = None


@dataclass(frozen=True)
class ImageSequence:
    """One drive of a data set.

    Attributes:
        name: The traverse's name.
        images: The directory of the images.
        listing: The file that names them, for messages.
        frames: In order.
        has_poses: Whether there is a file of poses; frames without one are then left out.
    """

    name: str
    images: TreePath
    listing: TreePath
    frames: Sequence[SequenceFrame]
    has_poses: bool


def find_sequences(
    source: Path, is_sequence: Callable[[TreePath], bool], what: str, *, apart: bool = False
) -> FoundDirectories:
    """Returns the source if it is a sequence, else the sequences below it, in natural order of their names.

    Args:
        source: What the user gave.
        is_sequence: Says of a directory whether it is one.
        what: What a sequence must hold, for the message.
        apart: Each archive of a directory is a sequence of its own; see `find_directories`.

    Raises:
        RouteError: There is none, two have the same name (what is unpacked counts before its archive), or an archive is
            damaged.
    """
    found, notes = find_directories(source, is_sequence, apart=apart)
    if not found:
        raise RouteError(
            f"neither {readable(source)} nor a directory in it holds {what}; give a sequence or the directory above "
            "several"
        )
    named: dict[str, TreePath] = {}
    for place in found:
        other = named.setdefault(place.name, place)
        if other.is_on_disk and not place.is_on_disk:
            notes = [*notes, f"{readable(place.source)} holds {readable(place.name)} too, which is unpacked."]
        elif other is not place:
            raise RouteError(
                f"{readable(other)} and {readable(place)} would both be the sequence {readable(place.name)}; keep one "
                "of them, or rename it"
            )
    return FoundDirectories([named[name] for name in natural_sorted(named)], notes)


def read_trajectory(
    path: TreePath, seconds: Callable[[TextRow], float], separator: str | None = None, *, w_first: bool
) -> Trajectory:
    """Reads poses over time, a line `time x y z` and a quaternion each.

    Args:
        path: The file.
        seconds: Reads the time of a line.
        separator: What stands between two fields; None: white space.
        w_first: Whether w is the first of a quaternion's four numbers, or the last.

    Raises:
        RouteError: The file is malformed or holds no pose.
    """
    rows = list(read_rows(path, separator))
    if not rows:
        raise RouteError(f"{readable(path)} holds no pose; get the sequence again, or import with `poses=false`")
    quaternions = [read_quaternion(row, 4, w_first=w_first) for row in rows]
    return Trajectory.of([seconds(row) for row in rows], [row.floats(1, 4) for row in rows], rotation_of(quaternions))


def poses_at(
    trajectory: Trajectory, seconds: Sequence[float], limit: float, up: Up, camera: NDArray[np.float64] | None = None
) -> list[Pose | None]:
    """Returns the pose of each moment, None where no pose is near enough.

    Args:
        trajectory: Where the camera or its carrier was.
        seconds: M moments.
        limit: Seconds from which on a pose is too far away.
        up: The world's axis that points up.
        camera: 4×4, the camera's pose in the carrier's frame; None: the trajectory is the camera's.
    """
    positions, rotations, known = trajectory.at(np.asarray(seconds, dtype=np.float64), limit)
    if camera is None:
        poses = plane_poses(positions, rotations, up)
    else:
        poses = plane_poses(positions + rotations.apply(camera[:3, 3]), rotations, up, camera[:3, 2].tolist())
    return [pose if there else None for pose, there in zip(poses, known, strict=True)]


def sequences_route(
    sequences: Sequence[ImageSequence], radius: float | None, why: str, notes: Sequence[str] = ()
) -> ForeignRoute:
    """Makes a route of sequences, one traverse each.

    Frames without a pose are left out of a sequence that has poses; a note says how many. All frames keep their
    own stems, so nothing shifts.

    Args:
        sequences: The sequences.
        radius: Metres by which a match may be off; None: not said.
        why: What it means that a frame has no pose ("no pose within 0.02 s").
        notes: Sentences to say first.

    Raises:
        RouteError: A sequence has no image, or poses, but none for any of its images.
    """
    said = list(notes)
    for sequence in sequences:
        if not sequence.frames:
            raise RouteError(f"{readable(sequence.listing)} names no image; get the sequence again")
        lost = sum(frame.pose is None for frame in sequence.frames)
        if not sequence.has_poses:
            said.append(f"The sequence {readable(sequence.name)} has no poses.")
        elif lost == len(sequence.frames):
            raise RouteError(
                f"of the {lost} images that {readable(sequence.listing)} names there is none with a pose: {why}; check "
                "that images and poses are of one sequence, or import without poses: `poses=false`"
            )
        elif lost:
            said.append(
                f"{lost} of {len(sequence.frames)} frames of {readable(sequence.name)} have {why} and were left out; "
                "`poses=false` keeps them, and leaves out all poses."
            )
    posed = all(sequence.has_poses for sequence in sequences)
    if posed and radius is None:
        said.append("The data set names no radius for the same place: say it in metres where you evaluate.")
    return ForeignRoute(
        traverses=(
            ForeignTraverse(sequence.name, _frames(sequence), count=len(_kept(sequence))) for sequence in sequences
        ),
        radius=radius if posed else None,
        notes=tuple(said),
        truth_from="the poses of the data set" if posed else "",
    )


def _kept(sequence: ImageSequence) -> list[SequenceFrame]:
    return [frame for frame in sequence.frames if frame.pose is not None or not sequence.has_poses]


def _frames(sequence: ImageSequence) -> Iterator[ForeignFrame]:
    names = {frame.name: frame for frame in _kept(sequence)}
    for frame, content in read_files(sequence.images, names, readable(sequence.listing)):
        yield ForeignFrame(frame.stem, content, frame.pose, frame.seconds)
