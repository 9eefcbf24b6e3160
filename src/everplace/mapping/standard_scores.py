"""Standard scores of a frame: what makes the scores of any method and any light comparable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ScoreMoments", "bent_scores", "log_sum", "near_values", "score_moments", "standard_scores"]

_BEND = 0.12
"""Share of its square that is added to a standard score above 0. Cosines of random places do not reach as far as normal
numbers do, so a high one says more than in proportion; without it, maps of 10^5 places doubt what is right."""


@dataclass(frozen=True, eq=False)
class ScoreMoments:
    """What all places of a map score, where a search has found only the best of them.

    Attributes:
        mean: (...) mean over all places, by frame.
        deviation: (...) standard deviation over all places.
        places: P, their number.
    """

    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    places: int


def score_moments(
    queries: NDArray[np.floating[Any]], mean: NDArray[np.float64], covariance: NDArray[np.float64], places: int
) -> ScoreMoments:
    """Mean and deviation of the cosines with all places, without a look at any: exact, and of no cost.

    Args:
        queries: ...×D descriptors of length 1.
        mean: (D,), of the places' descriptors of length 1.
        covariance: D×D, of the same.
        places: Their number.
    """
    q = np.asarray(queries, np.float64)
    variance = np.einsum("...d,de,...e->...", q, covariance, q, optimize=True)
    return ScoreMoments(q @ mean, np.sqrt(np.maximum(variance, 0)), places)


def standard_scores(
    scores: NDArray[Any], whole: ScoreMoments | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How many standard deviations each score lies above the mean of its frame's scores.

    Args:
        scores: ...×P; NaN: none.
        whole: Where scores are given for the best places only, what all places score; None: all are given.

    Returns:
        ...×P, 0 where a frame's scores do not vary, NaN where there is none; and the logarithm of the number of places.
    """
    S = np.asarray(scores, np.float64)
    known = np.isfinite(S)
    if whole is not None:
        mean, deviation = np.asarray(whole.mean)[..., None], np.asarray(whole.deviation)[..., None]
        places = np.full(S.shape[:-1], whole.places)
    else:
        places = known.sum(axis=-1)
        count = np.maximum(places, 1)[..., None]
        mean = S.sum(axis=-1, keepdims=True, where=known) / count
        deviation = np.sqrt(np.square(S - mean).sum(axis=-1, keepdims=True, where=known) / count)
    varies = deviation > 1e-12 * np.maximum(np.abs(mean), 1)  # less is rounding
    z = np.divide(S - mean, deviation, out=np.zeros_like(S), where=varies & known)
    z[~known] = np.nan
    return z, np.log(np.maximum(places, 1))


def log_sum(z: NDArray[np.float64], slope: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Log Σ exp(slope z) over the places that have a score, and its derivative by the slope.

    Args:
        z: ...×P; NaN: no score.
        slope: Positive.

    Returns:
        The two, of shape (...): -inf and 0 where no place has a score.
    """
    exponents = np.where(np.isnan(z), -np.inf, slope * z)
    largest = exponents.max(axis=-1, keepdims=True, initial=-1e300)
    weights = np.exp(exponents - largest)
    total = weights.sum(axis=-1)
    with np.errstate(divide="ignore"):
        value: NDArray[np.float64] = np.log(total) + largest[..., 0]
    return value, (weights * np.nan_to_num(z)).sum(axis=-1) / np.maximum(total, np.finfo(np.float64).tiny)


def bent_scores(
    scores: NDArray[Any], whole: ScoreMoments | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Standard scores in which what lies above the mean is bent upwards: z + 0.12 z².

    Args:
        scores: ...×P as in `standard_scores`.
        whole: As there.

    Returns:
        As there.
    """
    z, log_places = standard_scores(scores, whole)
    return z + _BEND * np.square(np.maximum(z, 0)), log_places


def near_values(
    values: NDArray[np.float64], places: NDArray[np.int64], reach: int, beyond: float
) -> NDArray[np.float64]:
    """The values at a place of each frame and at the neighbours of this place.

    Args:
        values: ...×P.
        places: (...) positions among the P.
        reach: Neighbours on either side.
        beyond: What stands for neighbours outside the map.

    Returns:
        ...×(2 reach + 1).
    """
    columns = places[..., None] + np.arange(-reach, reach + 1)
    inside = (columns >= 0) & (columns < values.shape[-1])
    taken = np.take_along_axis(values, columns.clip(0, values.shape[-1] - 1), axis=-1)
    return np.where(inside, taken, beyond)
