"""What a frame scores at every place of a map: exactly, or on a large map exactly where it matters.

The probability of a place takes the scores of all places: their mean and deviation, and how much all others together
speak for themselves. On a map of 100,000 frames and more, a graph (`everplace.mapping.frame_graph`) finds the 256
frames that are most alike, and these count with their exact scores. Of all other places a sample is scored, 4,096 of
them, evenly along the route: exactly too, and always the same ones. A place that is neither takes the score of the
sampled place nearest along the route that is not among the best, and at most that of the last of the best. So the
scores that were not looked at are distributed as those of the sample are; mean, deviation and the weight of all places
come out as they would, whatever form that distribution has, and neighbours have like scores, as they do. What is near
the best is never guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.frame_graph import FrameGraph
from everplace.mapping.place_scores import PlaceFrames
from everplace.route.selection import spread

__all__ = ["EXACT_BELOW", "FrameScores", "PlaceSearch"]

EXACT_BELOW = 100_000
"""Frames of a map from which on a graph is searched."""
_CANDIDATES = 256
_SAMPLED = 4096
"""Places that are scored for all others."""
_MOST_LEFT_OUT = 4096
"""Frames left out from which on an exact search is faster than one that meets them all."""


@dataclass(frozen=True, eq=False)
class FrameScores:
    """What one frame scores.

    Attributes:
        places: (P,) of every place; NaN: all of its frames are left out.
        frames: (N,) cosines with the frames of the map, in the order of `PlaceFrames.rows`, -inf: left out; None: most
            were not looked at.
    """

    places: NDArray[np.float32]
    frames: NDArray[np.float32] | None = None


class PlaceSearch:
    """Scores frames on one map."""

    def __init__(self, vectors: NDArray[np.float32], order: PlaceFrames, graph: FrameGraph | None = None) -> None:
        """Takes the map.

        Args:
            vectors: N×D of length 1, in the order of `order.rows`.
            order: Its places.
            graph: Of the vectors; None: every search is exact.
        """
        self._vectors, self._order, self._graph = vectors, order, graph
        self._sampled = np.array(spread(len(order), _SAMPLED), np.int64)
        self._ends = np.append(order.starts[1:], len(vectors))
        if graph is not None:
            self._place_of = np.repeat(np.arange(len(order)), self._ends - order.starts)
            self._sampled_frames = np.flatnonzero(np.isin(self._place_of, self._sampled))
            self._sampled_vectors = vectors[self._sampled_frames]

    def scores(self, vector: NDArray[np.float32], left_out: NDArray[np.bool_] | None = None) -> FrameScores:
        """Scores a frame.

        Args:
            vector: (D,) of length 1.
            left_out: (N,) frames of the map that do not match; None: all do.
        """
        if self._graph is None or (left_out is not None and left_out.sum() > _MOST_LEFT_OUT):
            frames = (vector[None] @ self._vectors.T)[0]
            if left_out is not None:
                frames[left_out] = -np.inf
            return FrameScores(_none_as_nan(self._order.fuse(frames)), frames)
        nearest = self._graph.nearest(vector, _CANDIDATES, left_out)
        best = self._vectors[nearest] @ vector
        others = self._sampled_vectors @ vector
        if left_out is not None:
            others[left_out[self._sampled_frames]] = -np.inf
        places = np.full(len(self._order), -np.inf, np.float32)
        np.maximum.at(places, self._place_of[self._sampled_frames], others)
        np.maximum.at(places, self._place_of[nearest], best)
        worst = best.min(initial=np.inf)
        unseen = np.isneginf(places)
        if left_out is not None:
            unseen &= ~np.logical_and.reduceat(left_out, self._order.starts)
        places[unseen] = np.minimum(self._from_sample(places, worst), worst)[unseen]
        return FrameScores(_none_as_nan(places))

    def best_frame(
        self, vector: NDArray[np.float32], found: FrameScores, column: int, left_out: NDArray[np.bool_] | None = None
    ) -> tuple[int, float]:
        """Position of the frame of a place that is most alike, and its cosine; -inf: all its frames are left out.

        Args:
            vector: As for `scores`.
            found: What that gave.
            column: The place.
            left_out: As for `scores`.
        """
        here = slice(self._order.starts[column], self._ends[column])
        if found.frames is not None:
            frames = found.frames[here]
        else:
            frames = self._vectors[here] @ vector
            if left_out is not None:
                frames[left_out[here]] = -np.inf
        best = int(frames.argmax())
        return int(here.start) + best, float(frames[best])

    def _from_sample(self, places: NDArray[np.float32], worst: np.float32) -> NDArray[np.float32]:
        """(P,) for each place the score of the nearest sampled one that is known and below the worst of the best."""
        usual = self._sampled[(places[self._sampled] < worst) & np.isfinite(places[self._sampled])]
        if not len(usual):
            return np.full(len(places), worst, np.float32)
        middle = (usual[1:] + usual[:-1] + 1) // 2
        count = np.diff(middle, prepend=0, append=len(places))
        return np.repeat(places[usual], count)


def _none_as_nan(places: NDArray[np.float32]) -> NDArray[np.float32]:
    places[np.isneginf(places)] = np.nan
    return places
