"""What is new in a frame after the one before, seen in their scores alone.

A robot that stands sees the same again, its chance agreements included. To count that frame by frame would make the
robot sure of a wrong place; and a stop would be a motion that no speed explains.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["new_in_frame", "new_in_frames"]

_FEWEST = 10  # pairs of places below which a correlation says nothing
_ROUNDING = 1e-12  # relative spread below which scores are equal


def new_in_frame(before: NDArray[Any], after: NDArray[Any], repeat: float) -> float:
    """Measures the change between two frames by the change that one step along the map would bring.

    The change is 1 - r with the correlation r of the two frames' scores. A camera that moves on by one place
    sees about its last scores moved by one place, so the step's change is 1 - the correlation of the frames' scores
    at neighbouring places, the mean of both frames. Where places change slowly, so may frames.

    Args:
        before: N scores of a frame against the places in the order of travel; what is not finite is none.
        after: N scores of the next frame.
        repeat: Share of the step's change from which on a frame is wholly new, positive.

    Returns:
        In [0, 1]; 0: the frames say the same of all places, shift and positive scale of the scores apart. 1 as well
        where it cannot be told, for want of places or of differences between them.
    """
    before, after = np.asarray(before, np.float64), np.asarray(after, np.float64)
    change = 1 - _correlation(before, after)
    step = 1 - (_correlation(before[:-1], before[1:]) + _correlation(after[:-1], after[1:])) / 2
    if np.isnan(change) or not step > 0:
        return 1.0
    return float(np.clip(change / (repeat * step), 0.0, 1.0))


def new_in_frames(S: NDArray[Any], repeat: float) -> NDArray[np.float64]:
    """Returns `new_in_frame` of every frame of a traverse after the one before, (M,); all of the first is new."""
    return np.array([1.0, *(new_in_frame(before, after, repeat) for before, after in pairwise(S))])


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Pearson's correlation over what both know; NaN: there is none."""
    both = np.isfinite(first) & np.isfinite(second)
    if not both.all():  # taking some out is slow
        first, second = first[both], second[both]
    if len(first) < _FEWEST:
        return np.nan
    means = first.mean(), second.mean()
    first, second = first - means[0], second - means[1]
    lengths = np.sqrt(first @ first), np.sqrt(second @ second)
    if any(length <= _ROUNDING * abs(mean) * np.sqrt(len(first)) for length, mean in zip(lengths, means, strict=True)):
        return np.nan
    return float(first @ second / (lengths[0] * lengths[1]))
