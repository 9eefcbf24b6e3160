"""Scores of places that have frames of several drives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["PlaceFrames"]


class PlaceFrames:
    """The frames of a map in the order of their places along the route.

    Attributes:
        rows: (N,) rows of the map's frames, place by place; frames without a place are left out.
        starts: (P,) where the frames of each place begin in `rows`.
        places: (P,) the places, in the order of travel.
        positions: (P,) where they lie.
    """

    def __init__(self, places: NDArray[np.int64], positions: NDArray[np.float64]) -> None:
        """Sorts.

        Args:
            places: Of the map's frames; -1: none.
            positions: Of the map's frames; frames of one place have the same.
        """
        known = np.flatnonzero(places >= 0)
        self.rows = known[np.lexsort((known, places[known], positions[known]))]
        ordered = places[self.rows]
        self.starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(ordered) else known
        self.places = ordered[self.starts]
        self.positions = positions[self.rows[self.starts]]

    def __len__(self) -> int:
        """Returns P."""
        return len(self.starts)

    @property
    def first(self) -> NDArray[np.int64]:
        """(P,) the row of each place's first frame: that of the oldest drive."""
        return self.rows[self.starts]

    def fuse(self, scores: NDArray[np.float32]) -> NDArray[np.float32]:
        """The score of a place is that of its best frame.

        A place that was seen once, or not under the query's condition, is not behind one that was seen often by
        more than a better match gives.

        Args:
            scores: ...×N, of the frames in the order of `rows`.

        Returns:
            ...×P.
        """
        fused: NDArray[np.float32] = np.maximum.reduceat(scores, self.starts, axis=-1)
        return fused
