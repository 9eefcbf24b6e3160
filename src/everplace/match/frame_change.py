"""Which frames show something new after those before them, seen in what they say of the places.

A robot that stands sees the same again, its chance agreements included. To count that frame by frame would make the
robot sure of a wrong place; a stop would be a motion that no speed explains; and the last L frames would soon be one
view, L times. So a frame that shows the last one again does not count as a frame of the drive.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.match.route_model import RouteModel, likelihood_ratios

__all__ = ["change_in_steps", "new_frames"]

_FEWEST = 10  # places below which a correlation says nothing


def change_in_steps(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Measures the change from one frame to another by the change that one step along the map would bring.

    The change is 1 - r with the correlation r of the two frames' evidence. A camera that moves on by one place
    sees about its last scores moved by one place, so the step's change is 1 - the correlation of the frames' evidence
    at neighbouring places, the mean of both frames. Where places change slowly, so may frames.

    Args:
        before: N log-likelihood ratios of a frame, of the places in the order of travel.
        after: N log-likelihood ratios of a later frame.

    Returns:
        Their ratio: about 0 where the frames say the same of all places; infinite where it cannot be told, for want of
        places or of differences between them.
    """
    if len(before) < _FEWEST:
        return np.inf
    change = 1 - _correlation(before, after)
    step = 1 - (_correlation(before[:-1], before[1:]) + _correlation(after[:-1], after[1:])) / 2
    return change / step if step > 0 and not np.isnan(change) else np.inf


def new_frames(S: NDArray[Any], model: RouteModel) -> NDArray[np.int64]:
    """Finds the frames of a traverse that show something new: `change_in_steps` of at least `RouteModel.repeat`.

    Each is compared with the last new one, not with the frame before: noise does not add up while a camera stands,
    and a slow motion does.

    Args:
        S: M×N scores, M at least 1; rows and columns in the order of travel; NaN: none.
        model: The assumptions.

    Returns:
        Positions of the new frames, ascending; the first is 0.
    """
    new = [0]
    last = np.log(likelihood_ratios(S[0], model))
    for frame in range(1, len(S)):
        evidence = np.log(likelihood_ratios(S[frame], model))
        if change_in_steps(last, evidence) >= model.repeat:
            new.append(frame)
            last = evidence
    return np.array(new)


def _correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Pearson's correlation; NaN: one of the two does not vary."""
    first, second = first - first.mean(), second - second.mean()
    size = np.sqrt((first @ first) * (second @ second))
    return float(first @ second / size) if size > 0 else np.nan
