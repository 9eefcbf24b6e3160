"""Which frames show something new after those before them, seen in what they say of the places.

A standing robot sees the same view again, including its chance matches. Counting each of these frames would make the
filter too sure of itself, a stop would contradict the motion model, and the last L frames would soon be L copies of one
view. So a frame that repeats the last new one does not count as a frame of the drive, and of one that repeats it in
part only the rest is heard (`everplace.sequences.evidence.news`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.sequences.evidence import likelihood_ratios, news, standardised
from everplace.sequences.route_model import RouteModel

__all__ = ["DriveEvidence", "View", "change_in_steps", "new_frames"]

_FEWEST = 10  # places below which a correlation says nothing


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What one frame says of the N places, in the order of travel.

    Attributes:
        evidence: N log-likelihood ratios, less their mean.
        size: The sum of their squares.
        step: 1 - the correlation of the evidence at neighbouring places; NaN where there is none.
    """

    evidence: NDArray[np.float64]
    size: float
    step: float

    @classmethod
    def of(cls, ratios: NDArray[np.float64]) -> View:
        """Takes the N ratios of a frame (`likelihood_ratios`)."""
        evidence: NDArray[np.float64] = np.log(ratios)
        evidence -= evidence.mean()
        size = float(evidence @ evidence)
        # All entries but the last, and all but the first, have known sums: that of all is 0.
        first, last, pairs = float(evidence[0]), float(evidence[-1]), max(len(evidence) - 1, 1)
        product = float(evidence[:-1] @ evidence[1:]) - first * last / pairs
        spreads = (size - last**2 - last**2 / pairs, size - first**2 - first**2 / pairs)
        return cls(evidence, size, 1 - _ratio(product, *spreads))


def change_in_steps(before: View, after: View) -> float:
    """Measures the change from one frame to another by the change that one step along the map would bring.

    The change is 1 - r with the correlation r of the two frames' evidence. A camera that moves on by one place
    sees about its last scores moved by one place, so the step's change is 1 - the correlation of the frames' evidence
    at neighbouring places, the mean of both frames. Where places change slowly, so may frames.

    Args:
        before: A frame.
        after: A later frame, of the same places.

    Returns:
        Their ratio: about 0 where the frames say the same of all places; infinite where it cannot be told, for want of
        places or of differences between them.
    """
    if len(before.evidence) < _FEWEST:
        return np.inf
    change = 1 - _ratio(float(before.evidence @ after.evidence), before.size, after.size)
    step = (before.step + after.step) / 2
    return change / step if step > 0 and not np.isnan(change) else np.inf


class DriveEvidence:
    """What the frames of a traverse say of the places, one after the other.

    Attributes:
        new: Positions of the V frames that show something new, ascending; the first is 0.
        shown: V: how many frames show what each of them does.
    """

    def __init__(self, S: NDArray[Any], model: RouteModel) -> None:
        """Finds the new frames: those that bring a `change_in_steps` of at least `RouteModel.repeat`.

        Each is compared with the last new one, not with the frame before: noise does not add up while a camera stands,
        and a slow motion does.

        Args:
            S: M×N scores, M at least 1; rows and columns in the order of travel; NaN: none.
            model: The assumptions.
        """
        new, changes = [0], [np.inf]
        last = View.of(likelihood_ratios(standardised(S[0]), model))
        for frame in range(1, len(S)):
            view = View.of(likelihood_ratios(standardised(S[frame]), model))
            change = change_in_steps(last, view)
            if change >= model.repeat:
                new.append(frame)
                changes.append(change)
                last = view
        self.new = np.array(new)
        self.shown = np.diff(np.append(self.new, len(S)))
        self._changes = np.array(changes)
        self._S, self._model = S, model

    def alone(self, view: int) -> NDArray[np.float64]:
        """Returns N: the likelihood ratios of a new frame of which no frame before is known."""
        return likelihood_ratios(standardised(self._S[self.new[view]]), self._model)

    def after_others(self, begin: int, end: int) -> NDArray[np.float64]:
        """Returns (end - begin)×N: the likelihood ratios of new frames, each after the one before it."""
        first = max(begin - 1, 0)
        z = standardised(self._S[self.new[first:end]])
        before = z[np.maximum(np.arange(begin, end) - 1 - first, 0)]
        return likelihood_ratios(news(z[begin - first :], before, self._changes[begin:end]), self._model)


def new_frames(S: NDArray[Any], model: RouteModel) -> NDArray[np.int64]:
    """Returns the positions of the frames of a traverse that show something new (`DriveEvidence`)."""
    return DriveEvidence(S, model).new


def _ratio(product: float, first: float, second: float) -> float:
    """A correlation from a sum of products and two of squares; NaN: one of the two does not vary."""
    size = first * second
    return product / math.sqrt(size) if size > 0 else math.nan
