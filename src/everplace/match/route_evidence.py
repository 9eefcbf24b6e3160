"""What each frame of a drive says, given the frames before it: the background of every place, and what is new.

Some places look like everything, in one season more than in another, and attract every frame. And a frame taken where
the last one was taken says the same again, its chance agreements included. Both show in the scores alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.match.route_model import RouteModel, likelihood_ratios, standard_scores

__all__ = ["RouteEvidence"]

_HIGHEST = 2.0  # a higher standard score may well be of the place itself, and is no background
_CHANGE, _CHANGES = 0.5, 5.0  # what is taken for the usual change before the first frames, and as how many of them


class RouteEvidence:
    """Weighs one frame after the other against the background of the frames before.

    A frame's standard scores z = (score - mean) / deviation over its places are taken for each place against the mean
    m and the deviation s that z had there so far, of values up to 2: y = (z - m) / s. The model's `background` frames
    of mean 0 and deviation 1 count as seen before the first. Where one place is seen again and again, its own high
    scores are cut, so that it stays well above its background.

    What is new in a frame is w = min(1, (1 - r) / (c a)): r is the correlation of its y with that of the frame
    before, a the mean of 1 - r so far, and c = `repeat`. On a robot that stands w is near 0, on one that moves it is
    1. A frame counts by w: in the background, in a, and where it is used (`Belief.see`, `Belief.move`).

    Memory is that of a few numbers a place.
    """

    def __init__(self, places: int, model: RouteModel) -> None:
        """Starts with the first frame of a drive against N places."""
        self._model = model
        self._count = np.full(places, model.background)
        self._total = np.zeros(places)
        self._squares = np.full(places, model.background)
        self._mean = np.zeros(places)
        self._spread = np.ones(places)
        self._change = _CHANGE * _CHANGES
        self._changes = _CHANGES
        self._last: NDArray[np.float64] | None = None

    def copy(self) -> RouteEvidence:
        """The same state, which goes on by itself."""
        twin = RouteEvidence.__new__(RouteEvidence)
        twin.__dict__.update(
            {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()}
        )
        return twin

    def weigh(self, scores: NDArray[Any]) -> tuple[NDArray[np.float64], float]:
        """Takes the next frame.

        Args:
            scores: N scores, higher = more alike; NaN: none. Shift and positive scale do not matter.

        Returns:
            Its N likelihood ratios, as if all of it were new, and w, what is new in it, in [0, 1].
        """
        z = standard_scores(scores)
        y = self._against_background(z)
        ratios = likelihood_ratios(y, self._model)
        new = 1.0 if self._last is None else self._new(y, self._against_background(self._last))
        self._last = z
        self._learn(z, new)
        return ratios, new

    def weigh_all(self, S: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Takes the next F frames: F×N ratios and F weights."""
        ratios, new = np.empty(S.shape), np.empty(len(S))
        for frame, scores in enumerate(S):
            ratios[frame], new[frame] = self.weigh(scores)
        return ratios, new

    def _against_background(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        y = z - self._mean
        y /= self._spread
        return y

    def _new(self, y: NDArray[np.float64], last: NDArray[np.float64]) -> float:
        """What is new in a frame after the last one, both against the same background."""
        both = np.isfinite(y) & np.isfinite(last)
        if not both.all():  # taking some out is slow
            y, last = y[both], last[both]
        if not len(y):
            return 1.0
        y, last = y - y.mean(), last - last.mean()
        scale = float(np.sqrt((y @ y) * (last @ last)))
        if not scale > 1e-12 * len(y):
            return 1.0
        change = max(1 - float(y @ last) / scale, 0.0)
        new = min(1.0, change * self._changes / (self._model.repeat * self._change))
        self._change += new * change
        self._changes += new
        return new

    def _learn(self, z: NDArray[np.float64], new: float) -> None:
        """Adds the frame to the background."""
        known = np.isfinite(z)
        if known.all():
            self._count += new
            z = np.minimum(z, _HIGHEST)
        else:
            self._count += new * known
            z = np.where(known, np.minimum(z, _HIGHEST), 0.0)
        self._total += new * z
        z *= z
        z *= new
        self._squares += z
        np.divide(self._total, self._count, out=self._mean)
        np.divide(self._squares, self._count, out=self._spread)
        self._spread -= self._mean * self._mean
        np.sqrt(self._spread, out=self._spread)
