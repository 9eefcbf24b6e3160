"""One drive along a route: an ordered list of frames under one condition."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

__all__ = ["Frame", "Pose", "Traverse"]


class Pose(NamedTuple):
    """Where a frame was taken, in any fixed plane coordinate system.

    Attributes:
        x: Metres.
        y: Metres.
        heading: Radians, counter-clockwise from the x axis.
    """

    x: float
    y: float
    heading: float


class Frame(NamedTuple):
    """One image of a traverse.

    Attributes:
        stem: The file name without its ending; the same stem in two traverses is the same place.
        path: The image file.
        pose: Where it was taken, if the route has poses.
    """

    stem: str
    path: Path
    pose: Pose | None


@dataclass(frozen=True, eq=False, slots=True)
class Traverse(Sequence[Frame]):
    """A sequence of frames; made of plain columns, so that a million frames take little memory.

    Attributes:
        name: The name of its directory.
        condition: What it shows the route under ("winter"); two traverses may share one.
        root: The directory of its images.
        stems: The frames' stems, unique, in natural order.
        endings: The file ending of each stem, dot included.
        poses: N×3 float64 (x, y in metres, heading in radians), read-only, or None.
    """

    name: str
    condition: str
    root: Path
    stems: tuple[str, ...] = field(repr=False)
    endings: tuple[str, ...] = field(repr=False)
    poses: NDArray[np.float64] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        condition = "" if self.condition == self.name else f", {self.condition}"
        return f"Traverse({self.name}{condition}: {len(self)} frames{', with poses' if self.poses is not None else ''})"

    def __len__(self) -> int:
        """Returns the number of frames."""
        return len(self.stems)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> Traverse: ...

    def __getitem__(self, index: int | slice) -> Frame | Traverse:
        """Returns the frame at a position, or the traverse of a slice."""
        if isinstance(index, slice):
            return replace(
                self,
                stems=self.stems[index],
                endings=self.endings[index],
                poses=None if self.poses is None else self.poses[index],
            )
        index = operator.index(index)
        stem = self.stems[index]
        pose = None if self.poses is None else Pose(*self.poses[index].tolist())
        return Frame(stem, self.root / (stem + self.endings[index]), pose)

    def __iter__(self) -> Iterator[Frame]:
        """Yields the frames in order."""
        return (self[index] for index in range(len(self)))

    def take(self, indices: Sequence[int] | NDArray[np.integer]) -> Traverse:
        """Returns the traverse of the frames at these positions, in the order given."""
        positions = [operator.index(index) for index in indices]
        return replace(
            self,
            stems=tuple(self.stems[position] for position in positions),
            endings=tuple(self.endings[position] for position in positions),
            poses=None if self.poses is None else self.poses[positions],
        )

    @property
    def paths(self) -> tuple[Path, ...]:
        """The image files, in order."""
        return tuple(self.root / (stem + ending) for stem, ending in zip(self.stems, self.endings, strict=True))
