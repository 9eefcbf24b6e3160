"""How much the scores change from one frame to the next, and what is therefore new in a frame.

A robot that stands sees the same again, its chance agreements included. To count that frame by frame would make the
robot sure of a wrong place; and a stop would be a motion that no speed explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["UsualChange", "change_between", "frame_changes", "new_in_frames"]

_FEWEST = 10  # places below which a correlation says nothing
_ASSUMED, _FRAMES = 0.5, 5.0  # the usual change before the first frames, and as how many of them it counts


def change_between(before: NDArray[Any], after: NDArray[Any]) -> float:
    """Returns 1 - r of the correlation r of two frames' scores over the places that both have a score of.

    Args:
        before: N scores of a frame; what is not finite is none.
        after: N scores of the next frame.

    Returns:
        In [0, 2]; 0: they say the same of all places, shift and positive scale of the scores apart. NaN: it cannot be
        told, for want of places or of differences between them.
    """
    before, after = np.asarray(before, np.float64), np.asarray(after, np.float64)
    both = np.isfinite(before) & np.isfinite(after)
    if not both.all():  # taking some out is slow
        before, after = before[both], after[both]
    if len(before) < _FEWEST:
        return np.nan
    before, after = before - before.mean(), after - after.mean()
    scale = float(np.sqrt((before @ before) * (after @ after)))
    return max(1 - float(before @ after) / scale, 0.0) if scale > 0 else np.nan


def frame_changes(S: NDArray[Any]) -> NDArray[np.float64]:
    """Returns `change_between` of every frame and the one before, (M,); of the first, which has none, NaN."""
    changes = [change_between(before, after) for before, after in pairwise(S)]
    return np.array([np.nan, *changes])


@dataclass(slots=True, eq=False)
class UsualChange:
    """How much the frames of B robots change usually: a mean over those so far, each counted as far as it is new.

    Attributes:
        total: B: the sum of the changes.
        frames: B: of how many.
    """

    total: NDArray[np.float64]
    frames: NDArray[np.float64]

    @classmethod
    def start(cls, robots: int) -> UsualChange:
        """Before the first frame."""
        return cls(np.full(robots, _ASSUMED * _FRAMES), np.full(robots, _FRAMES))

    def __getitem__(self, rows: slice) -> UsualChange:
        """The same of some of the robots, not copied."""
        return UsualChange(self.total[rows], self.frames[rows])

    def take(self, change: NDArray[np.float64], repeat: float) -> NDArray[np.float64]:
        """Takes the next frame of each robot.

        Args:
            change: B, of `frame_changes`; NaN: unknown, and the frame counts as new.
            repeat: Share of the usual change from which on a frame is wholly new.

        Returns:
            B: what is new in the frame, in [0, 1].
        """
        new = np.minimum(change * self.frames / (repeat * self.total), 1.0)
        unknown = np.isnan(new)
        self.total += np.where(unknown, 0.0, new * change)
        self.frames += np.where(unknown, 0.0, new)
        new[unknown] = 1.0
        return new


def new_in_frames(S: NDArray[Any], repeat: float) -> NDArray[np.float64]:
    """Returns what is new in every frame of a traverse, (M,) in [0, 1], given all frames before it."""
    usual = UsualChange.start(1)
    return np.array([1.0, *(usual.take(np.array([change]), repeat)[0] for change in frame_changes(S)[1:])])
