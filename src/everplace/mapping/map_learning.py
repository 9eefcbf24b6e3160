"""What a map learns from its drives: the projection to its descriptor, and how sure its answers are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.adaptation.drive_statistics import DriveStatistics, half_differences
from everplace.adaptation.moments import Moments
from everplace.adaptation.place_weights import pair_weights, place_weights
from everplace.adaptation.prior import Prior
from everplace.adaptation.route_adaptation import taught_projection
from everplace.mapping.calibration import PROVISIONAL, Calibration, fit_calibration
from everplace.mapping.held_out_answers import HeldOutAnswers, follows_none, sequence_answers, some_stretches, stretches
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.reliability import STRETCH
from everplace.match.similarity import directions

__all__ = ["Learnt", "MapFrames", "learn", "light_arrays", "light_of"]

_FEWEST = 100
"""Pairs from which a map is calibrated by its own."""
_MOST = 2000
"""Queries that a calibration looks at."""
_REACH = 1


@dataclass(frozen=True, eq=False)
class MapFrames:
    """The frames of a map, in the order of drives and frames.

    Attributes:
        features: N×F float16.
        drives: (N,) number of each frame's drive.
        places: (N,); -1: none.
        positions: (N,).
        sure: (N,) whether the frame was matched with a place that the map had.
        between: (N,) place that a frame without one is most likely next to; -1: none.
        learns: For each drive, whether it teaches the descriptor.
    """

    features: NDArray[np.float16]
    drives: NDArray[np.int64]
    places: NDArray[np.int64]
    positions: NDArray[np.float64]
    sure: NDArray[np.bool_]
    between: NDArray[np.int64]
    learns: Sequence[bool]


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Frames of later drives with the first frame of their place.

    Attributes:
        rows: (K,) of the later frames, in the order of drives and frames.
        places: (K,) columns of the map.
        changes: K×F half differences.
        weights: (K,).
    """

    rows: NDArray[np.int64]
    places: NDArray[np.int64]
    changes: NDArray[np.float32]
    weights: NDArray[np.float64]

    def take(self, kept: NDArray[np.bool_]) -> _Pairs:
        return _Pairs(self.rows[kept], self.places[kept], self.changes[kept], self.weights[kept])


@dataclass(frozen=True, eq=False)
class Learnt:
    """What a map learnt from its drives.

    Attributes:
        projection: From the method's numbers to the map's descriptor.
        calibration: How scores become probabilities.
        held_out: What it answered to frames that were held out; none: it learnt from few pairs.
        known: What it was made from: pairs, and the prior's weight.
    """

    projection: Projection
    calibration: Calibration
    held_out: HeldOutAnswers
    known: dict[str, float]


def learn(frames: MapFrames, light: Moments, dimensions: int, prior: Prior | None) -> Learnt:
    """The map's projection and calibration, from all its drives.

    Args:
        frames: Of all drives.
        light: What other light changes in them.
        dimensions: D; lowered to the number of places less one.
        prior: Scatter within places on other routes.
    """
    order = PlaceFrames(frames.places, frames.positions)
    there = frames.features[order.first].astype(np.float32)
    weights = place_weights(there)
    pairs = _pairs(frames, order, there, weights)
    base = DriveStatistics(Moments.of(there, weights), light, Moments.none(there.shape[1]))

    def solved(some: _Pairs) -> tuple[Projection, float]:
        return taught_projection(base, some.changes, some.weights, dimensions, prior)

    projection, weight = solved(pairs)
    known = {"pairs": float(len(pairs.rows)), "prior_weight": weight}
    if len(pairs.rows) < _FEWEST:
        return Learnt(projection, PROVISIONAL, HeldOutAnswers.none(), known)
    return Learnt(projection, *calibrate(frames, order, pairs, lambda kept: solved(pairs.take(kept))[0]), known)


def calibrate(
    frames: MapFrames, order: PlaceFrames, pairs: _Pairs, solve: Callable[[NDArray[np.bool_]], Projection]
) -> tuple[Calibration, HeldOutAnswers]:
    """How sure answers are, by frames that were held out of what was learnt.

    The pairs are cut into stretches of 24, and every second one is looked for with the projection that the others
    give, on the map without its own drive. Frames that could not be matched surely, but lie between two that were, are
    looked for as well: the sure ones alone are the easy ones.

    Args:
        frames: Of the map.
        order: Its places.
        pairs: What it learns from.
        solve: Gives the projection by some of the pairs.

    Returns:
        The calibration, and what the map answers to the same frames; where no other drive shows their places, the
        provisional one and none.
    """
    column = {int(place): index for index, place in enumerate(order.places)}
    queries = np.flatnonzero(frames.sure | (frames.between >= 0))
    queries = queries[[bool(frames.learns[drive]) for drive in frames.drives[queries]]]
    true = np.array([column.get(_place(frames, row), -1) for row in queries.tolist()], np.int64)
    queries, true = queries[true >= 0], true[true >= 0]
    stretch = stretches(follows_none(queries, frames.drives[queries]))
    kept = some_stretches(stretch, _MOST)
    queries, true = queries[kept], true[kept]
    stretch = np.unique(stretch[kept], return_inverse=True)[1]
    half = (np.arange(len(frames.places)) // STRETCH) % 2  # of rows, so that a pair and its query agree
    scores = np.empty((len(queries), len(order)), np.float32)
    for held in (0, 1):
        projection = solve(half[pairs.rows] != held)
        vectors = directions(projection.apply(frames.features))
        mine = half[queries] == held
        found = vectors[queries[mine]] @ vectors[order.rows].T
        own = frames.drives[queries[mine]][:, None] == frames.drives[order.rows][None]
        found[own] = -np.inf
        scores[mine] = order.fuse(found)
    scores[~np.isfinite(scores)] = np.nan  # a place of the query's own drive alone
    seen = ~np.isnan(scores[np.arange(len(queries)), true])
    if not seen.any():
        return PROVISIONAL, HeldOutAnswers.none()
    found = fit_calibration(scores[seen], true[seen], _REACH)
    apart = follows_none(queries[seen], frames.drives[queries[seen]])
    return found, sequence_answers(scores[seen], true[seen], stretch[seen], apart, found)


def _pairs(frames: MapFrames, order: PlaceFrames, there: NDArray[np.float32], weights: NDArray[np.float64]) -> _Pairs:
    column = np.full(int(frames.places.max(initial=0)) + 1, -1, np.int64)
    column[order.places] = np.arange(len(order))
    later = frames.sure & (frames.places >= 0)
    later[order.first] = False
    rows, places, weighed = [], [], []
    for drive, learns in enumerate(frames.learns):
        mine = np.flatnonzero(later & (frames.drives == drive))
        if learns and len(mine):
            own = place_weights(frames.features[mine].astype(np.float32))
            at = column[frames.places[mine]]
            rows.append(mine)
            places.append(at)
            weighed.append(pair_weights(at, weights, own))
    if not rows:
        return _Pairs(
            np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, there.shape[1]), np.float32), np.empty(0)
        )
    row, place = np.concatenate(rows), np.concatenate(places)
    changes = half_differences(frames.features[row].astype(np.float32), there[place])
    return _Pairs(row, place, changes, np.concatenate(weighed))


def _place(frames: MapFrames, row: int) -> int:
    return int(frames.places[row] if frames.sure[row] else frames.between[row])


def light_arrays(light: Moments) -> Mapping[str, NDArray[Any]]:
    """What other light changes, in few numbers: its best approximation of rank 256 and the rest of its variance."""
    low = Prior.of(light.second_moment(), "light", {})
    return {
        "light.directions": low.directions,
        "light.variances": low.variances,
        "light.rest": np.array([low.rest, light.weight], np.float64),
    }


def light_of(arrays: Mapping[str, NDArray[Any]]) -> Moments:
    """What `light_arrays` kept."""
    rest, weight = (float(number) for number in arrays["light.rest"])
    low = Prior(arrays["light.directions"], arrays["light.variances"], rest, "light")
    return Moments(weight, np.zeros(low.directions.shape[1]), weight * low.within())
