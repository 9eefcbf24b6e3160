"""A large map as descriptors, made so that they lie as adapted ones do.

Neighbouring places look alike, and less so the farther apart; the first numbers vary most; each drive, and more so a
query, sees a place with changes of its own. Against `hog16`, adapted to Nordland's places 0 to 999: the cosine of a
query (winter, there) with its place is 0.57 as the median (there 0.60), that of other places deviates by 0.13 (0.12),
and the numbers vary as 46 independent ones would (68). Neighbours are more alike, 0.67 (0.23), as the frames of a
camera are, which Nordland's are too far apart for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.match.similarity import directions

__all__ = ["NUMBERS", "MadeMap"]

NUMBERS = 96
_ALIKE = 0.85
_DECAY = 0.35
_DRIVE_CHANGES, _QUERY_CHANGES = 0.5, 1.2


class MadeMap:
    """Places, each seen by several drives.

    Attributes:
        places: (N,) the place of each frame, place by place.
        vectors: N×96 of length 1.
    """

    def __init__(self, places: int, drives: int) -> None:
        """Makes the map, always the same."""
        self._rng = np.random.default_rng(0)
        self._views = self._rng.standard_normal((places, NUMBERS), np.float32)
        for place in range(1, places):
            self._views[place] = _ALIKE * self._views[place - 1] + np.sqrt(1 - _ALIKE**2) * self._views[place]
        self._views *= np.arange(1, NUMBERS + 1, dtype=np.float32) ** -_DECAY
        self.places = np.repeat(np.arange(places), drives)
        self.vectors = self._seen(self.places, _DRIVE_CHANGES)

    def queries(self, count: int) -> NDArray[np.float32]:
        """Frames of a further drive, count×96 of length 1."""
        return self._seen(self._rng.integers(0, len(self._views), count), _QUERY_CHANGES)

    def _seen(self, places: NDArray[np.int64], changes: float) -> NDArray[np.float32]:
        noise = self._rng.standard_normal((len(places), NUMBERS), np.float32)
        noise *= np.float32(changes * self._views.std())
        noise += self._views[places]
        return directions(noise)
