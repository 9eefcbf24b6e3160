"""Which frames show something new after those before them, seen in their scores alone.

A robot that stands sees the same again, its chance agreements included. To count that frame by frame would make the
robot sure of a wrong place; a stop would be a motion that no speed explains; and the last L frames would soon be one
view, L times. So a frame that shows the last one again does not count as a frame of the drive.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["change_in_steps", "new_frames"]

_FEWEST = 10  # pairs of places below which a correlation says nothing
_ROUNDING = 1e-12  # relative spread below which scores are equal


def change_in_steps(before: NDArray[Any], after: NDArray[Any]) -> float:
    """Measures the change from one frame to another by the change that one step along the map would bring.

    The change is 1 - r with the correlation r of the two frames' scores. A camera that moves on by one place
    sees about its last scores moved by one place, so the step's change is 1 - the correlation of the frames' scores
    at neighbouring places, the mean of both frames. Where places change slowly, so may frames.

    Args:
        before: N scores of a frame against the places in the order of travel; what is not finite is none.
        after: N scores of a later frame.

    Returns:
        Their ratio: about 0 where the frames say the same of all places, shift and positive scale of the scores apart;
        infinite where it cannot be told, for want of places or of differences between them.
    """
    before, after = np.asarray(before, np.float64), np.asarray(after, np.float64)
    change = 1 - _correlation(before, after)
    step = 1 - (_correlation(before[:-1], before[1:]) + _correlation(after[:-1], after[1:])) / 2
    return change / step if step > 0 and not np.isnan(change) else np.inf


def new_frames(S: NDArray[Any], repeat: float) -> NDArray[np.int64]:
    """Finds the frames of a traverse that show something new.

    Each is compared with the last new one, not with the frame before: noise does not add up while a camera stands,
    and a slow motion does.

    Args:
        S: M×N scores, M at least 1; rows and columns in the order of travel.
        repeat: `change_in_steps` below which a frame shows the last new one again, positive.

    Returns:
        Positions of the new frames, ascending; the first is 0.
    """
    new = [0]
    for frame in range(1, len(S)):
        if change_in_steps(S[new[-1]], S[frame]) >= repeat:
            new.append(frame)
    return np.array(new)


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
