"""Whether probabilities keep their word: reliability diagram, calibration error, Brier score, and thresholds.

Neighbouring frames err together, so intervals come from drawing whole stretches of 24 frames with replacement (block
bootstrap, Künsch 1989), not single frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BINS", "STRETCH", "Interval", "Measured", "ReliabilityBins", "brier_score", "expected_calibration_error",
    "reliability_bins", "threshold_for", "with_interval",
]  # fmt: skip

BINS = 15
STRETCH = 24
_DRAWS = 1000
_SEED = 0

Interval = tuple[float, float]
Probabilities = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Measured:
    """A number with its 95 % interval."""

    value: float
    interval: Interval


@dataclass(frozen=True, eq=False)
class ReliabilityBins:
    """What a reliability diagram shows: answers sorted by their probability into bins of equal width.

    Attributes:
        counts: (15,) answers in each bin.
        probability: (15,) their mean probability; NaN where there is none.
        right: (15,) the share of them that is right; NaN where there is none.
        low: (15,) lower end of its 95 % interval; NaN where there is none.
        high: (15,) upper end.
    """

    counts: NDArray[np.int64]
    probability: NDArray[np.float64]
    right: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def reliability_bins(probabilities: Probabilities, right: NDArray[np.bool_]) -> ReliabilityBins:
    """Sorts answers into 15 bins.

    Args:
        probabilities: (M,) in [0, 1], in the order of travel.
        right: (M,) whether each answer is right.

    Returns:
        The bins, with intervals over stretches.
    """
    p, hits = np.asarray(probabilities, np.float64), np.asarray(right, np.float64)
    bins = _bin(p)
    counts = np.bincount(bins, minlength=BINS)
    share = _ratio(np.bincount(bins, hits, BINS), counts)
    stretch = np.arange(len(p)) // STRETCH
    cell = stretch * BINS + bins
    shape = (_stretches(p), BINS)
    of, good = (np.bincount(cell, weight, shape[0] * BINS).reshape(shape) for weight in (np.ones(len(p)), hits))
    draws = _drawn(shape[0])
    low, high = _percentiles(_ratio(draws @ good, draws @ of))
    return ReliabilityBins(counts, _ratio(np.bincount(bins, p, BINS), counts), share, low, high)


def expected_calibration_error(
    probabilities: Probabilities, right: NDArray[np.bool_], weights: Probabilities | None = None
) -> float:
    """Mean distance between what is said and what is right, over 15 bins of equal width (Naeini et al. 2015).

    Args:
        probabilities: Of any shape, in [0, 1].
        right: Whether each answer is right.
        weights: How much each answer counts; None: all alike.

    Returns:
        In [0, 1]; NaN without answers.
    """
    p, hits = np.ravel(probabilities).astype(np.float64), np.ravel(right).astype(np.float64)
    weight = np.ones(len(p)) if weights is None else np.ravel(weights)
    gap = np.bincount(_bin(p), weight * (p - hits), BINS)
    return float(np.abs(gap).sum() / weight.sum()) if len(p) else float("nan")


def brier_score(probabilities: Probabilities, right: NDArray[np.bool_], weights: Probabilities | None = None) -> float:
    """Mean squared distance between probability and outcome, 1 for right and 0 for wrong (Brier 1950).

    Args:
        probabilities: Of any shape, in [0, 1].
        right: Whether each answer is right.
        weights: How much each answer counts; None: all alike.

    Returns:
        In [0, 1]; NaN without answers.
    """
    squares = np.square(np.asarray(probabilities, np.float64) - np.asarray(right, np.float64))
    return float(np.average(squares, weights=weights)) if squares.size else float("nan")


def with_interval(
    measure: Callable[[Probabilities, NDArray[np.bool_], Probabilities | None], float],
    probabilities: Probabilities,
    right: NDArray[np.bool_],
    weights: Probabilities | None = None,
) -> Measured:
    """Measures answers, and how much the measure would vary over other stretches of the kind.

    Args:
        measure: `expected_calibration_error` or `brier_score`.
        probabilities: M×..., the first axis in the order of travel.
        right: Of the same shape.
        weights: Of the same shape, or None.

    Returns:
        The value, and the 2.5 % and 97.5 % points of it over 1,000 draws of stretches of 24; the same at every call.
    """
    p, hits = np.asarray(probabilities), np.asarray(right)
    each = np.ones(p.shape) if weights is None else weights
    stretch = np.arange(len(p)) // STRETCH
    shape = (-1,) + (1,) * (p.ndim - 1)
    drawn = [measure(p, hits, each * counts[stretch].reshape(shape)) for counts in _drawn(_stretches(p))]
    low, high = np.nanpercentile(drawn, (2.5, 97.5)) if drawn else (np.nan, np.nan)
    return Measured(measure(p, hits, weights), (float(low), float(high)))


def threshold_for(precision: float, probabilities: Probabilities, right: NDArray[np.bool_]) -> tuple[float, Interval]:
    """The lowest threshold at which what is believed is right often enough.

    Args:
        precision: Wanted share of right answers among those with a probability of at least the threshold, in (0, 1].
        probabilities: (M,) in the order of travel.
        right: (M,) whether each answer is right.

    Returns:
        The threshold and its 95 % interval over stretches. Infinity stands for "no threshold reaches it", in the
        interval as well: few answers then show too little to promise that precision.
    """
    p, hits = np.asarray(probabilities, np.float64), np.asarray(right, np.float64)
    order = np.argsort(-p, kind="stable")
    last = (
        np.append(np.diff(p[order]) != 0, True) if len(p) else np.zeros(0, bool)
    )  # answers of one probability go together
    stretch = np.arange(len(p)) // STRETCH
    stretches = _stretches(p)

    def threshold(counts: NDArray[np.float64]) -> float:
        weight = counts[stretch[order]]
        of, good = np.cumsum(weight), np.cumsum(weight * hits[order])
        enough = last & (good >= precision * of - 1e-9) & (of > 0)
        return float(p[order][np.flatnonzero(enough)[-1]]) if enough.any() else np.inf

    drawn = [threshold(counts) for counts in _drawn(stretches)]
    ends = np.sort(drawn)[[int(0.025 * _DRAWS), int(0.975 * _DRAWS)]] if drawn else np.array([np.inf, np.inf])
    return threshold(np.ones(stretches)), (float(ends[0]), float(ends[1]))


def _bin(p: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.minimum((p * BINS).astype(np.int64), BINS - 1)


def _stretches(answers: NDArray[Any]) -> int:
    return -(-len(answers) // STRETCH)


def _drawn(stretches: int) -> NDArray[np.float64]:
    """1,000×K: how often each stretch is drawn; none without stretches."""
    if not stretches:
        return np.zeros((0, 0))
    return np.random.default_rng(_SEED).multinomial(stretches, np.full(stretches, 1 / stretches), _DRAWS).astype(float)


def _ratio(part: NDArray[Any], whole: NDArray[Any]) -> NDArray[np.float64]:
    ratio: NDArray[np.float64] = np.divide(part, whole, out=np.full(np.shape(whole), np.nan), where=whole > 0)
    return ratio


def _percentiles(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low, high = np.full(BINS, np.nan), np.full(BINS, np.nan)
    for number in range(values.shape[1]):
        known = values[:, number][np.isfinite(values[:, number])]
        if len(known):
            low[number], high[number] = np.percentile(known, (2.5, 97.5))
    return low, high
