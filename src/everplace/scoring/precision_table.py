"""Choosing a threshold: what recall is left at a wanted precision, how sure that is, and what it is good enough for.

The curve is that of the best matches (see `everplace.scoring.scores`). Its recall at a precision comes from one drive,
whose frames resemble their neighbours, so its interval comes from a bootstrap over stretches of consecutive queries: as
many stretches as make up the drive are drawn, with repetition and around its end, and the recall is measured anew, at
the threshold that gives the precision in the draw (circular block bootstrap; Politis and Romano, "A circular
block-resampling procedure for stationary data", in Exploring the Limits of Bootstrap, 1992).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.scoring.scores import best_proposals

__all__ = ["PRECISIONS", "AtPrecision", "good_enough_for", "precision_table"]

PRECISIONS = (90, 95, 99, 100)
"""Per cent."""

_DRAWS = 1000
_BLOCK = 1 << 20  # counts handled at once: 4 MiB
_LEAST_RECALL = 0.05
"""Where the interval begins lower, hardly a place is found, and a report recommends nothing."""

_LOOPS = 99
_USES = {
    _LOOPS: "closing loops in a map whose optimiser can drop a wrong one",
    95: "localising along a drive with a filter or a geometric check that drops single wrong matches",
    90: "proposals of which each is checked, by geometry or by eye",
}
"""What a precision, in per cent, is needed for; falling."""


@dataclass(frozen=True, slots=True)
class AtPrecision:
    """The best-match curve where its precision is at least a wanted one and its recall is largest.

    Attributes:
        threshold: The score from which on proposals are accepted; None: no threshold gives the precision.
        recall: Correct accepted proposals / queries that have a true match; 0 without a threshold.
        recall_interval: From 2.5 to 97.5 % of the recalls of the bootstrap.
        accepted: Number of accepted proposals.
        wrong: How many of them are wrong.
    """

    threshold: float | None
    recall: float
    recall_interval: tuple[float, float]
    accepted: int
    wrong: int

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values that JSON can hold."""
        return dataclasses.asdict(self)


def precision_table(S: NDArray[Any], truth: NDArray[np.bool_], *, seed: int = 0) -> dict[str, AtPrecision]:
    """Finds threshold and recall at each of `PRECISIONS`.

    Args:
        S: M×N scores, rows = queries in the order in which they were driven.
        truth: M×N bool, True where query and database frame show the same place.
        seed: Of the bootstrap.

    Returns:
        By the precision as text, as in JSON.

    Raises:
        DescriptorsError: As for `everplace.scoring.scores.evaluate`.
        RouteError: No query has a true match.
    """
    score, right, sought = best_proposals(S, truth)
    order = np.argsort(-score, kind="stable")
    ends = np.append(np.flatnonzero(np.diff(score[order])), len(order) - 1)  # equal scores are accepted at once
    sweep = _Sweep(order, ends, right, sought)
    at, accepted, correct = sweep.chosen(np.ones((1, len(score)), np.int32))
    found = correct / sought.sum()
    drawn = np.concatenate([sweep.recalls(weights) for weights in _draws(len(score), seed)])
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return {
        str(precision): AtPrecision(
            threshold=_plain(score[order][at[0, index]]) if accepted[0, index] else None,
            recall=float(found[0, index]),
            recall_interval=(round(float(low[index]), 4), round(float(high[index]), 4)),
            accepted=int(accepted[0, index]),
            wrong=int(accepted[0, index] - correct[0, index]),
        )
        for index, precision in enumerate(PRECISIONS)
    }


def good_enough_for(table: Mapping[str, AtPrecision]) -> str:
    """Says in one sentence what matches of these precisions may be used for.

    A precision counts as known where at least 3 / (1 - precision) proposals are accepted: so many must be right before
    an error rate of 1 - precision can be excluded, with 95 % confidence (the rule of three; Hanley and Lippman-Hand,
    JAMA 249, 1983).

    Args:
        table: As of `precision_table`.
    """
    few: list[str] = []
    for precision, use in _USES.items():
        row = table[str(precision)]
        if row.threshold is None or row.recall_interval[0] < _LEAST_RECALL:
            continue
        if row.accepted < (needed := math.ceil(300 / (100 - precision))):
            few.append(f"{row.accepted} accepted matches are too few to tell ({needed} would do)")
            continue
        reached = f"with a threshold of {row.threshold:.4g}, {precision} % of the matches are right and {_found(row)}"
        if precision == _LOOPS:
            return f"Good enough for {use}: {reached}."
        short = f"for which {few[0]}" if few else f"at which {_found(table[str(_LOOPS)])}"
        return f"Good enough for {use}: {reached}; closing loops takes {_LOOPS} %, {short}."
    if few:
        return f"Nobody can say what this is good enough for: at {precision} % precision, {few[-1]}."
    return (
        f"Not good enough to act upon: at {precision} % precision {_found(row)}; match over sequences, or try another "
        "method."
    )


def _found(row: AtPrecision) -> str:
    found, low, high = (f"{100 * share:.0f} %" for share in (row.recall, *row.recall_interval))
    return f"{found} of the places are found ({low} to {high})"


@dataclass(frozen=True, eq=False)
class _Sweep:
    """The sweep of a threshold over the best matches, with each query counted any number of times.

    Attributes:
        order: The queries by falling score.
        ends: Positions in that order at which a threshold may lie.
        right: By query, whether its proposal is right.
        sought: By query, whether it has a true match.
    """

    order: NDArray[np.intp]
    ends: NDArray[np.intp]
    right: NDArray[np.bool_]
    sought: NDArray[np.bool_]

    def chosen(self, weights: NDArray[np.int32]) -> tuple[NDArray[np.intp], NDArray[np.int32], NDArray[np.int32]]:
        """For B×M counts, B×P each: the position of the last accepted query, the accepted and the correct proposals."""
        ordered = weights[:, self.order]
        accepted = np.cumsum(ordered, axis=1, dtype=np.int32)[:, self.ends]
        correct = np.cumsum(ordered * self.right[self.order], axis=1, dtype=np.int32)[:, self.ends]
        best = []
        for precision in PRECISIONS:
            # In whole numbers, of which a ratio of floats would miss some.
            precise = np.where(100 * correct >= precision * accepted, correct, 0)
            best.append(precise.argmax(axis=1))
        at = np.stack(best, axis=1)
        rows = np.arange(len(weights))[:, None]
        reached = 100 * correct[rows, at] >= np.array(PRECISIONS) * accepted[rows, at]
        return self.ends[at], accepted[rows, at] * reached, correct[rows, at] * reached

    def recalls(self, weights: NDArray[np.int32]) -> NDArray[np.float64]:
        """For B×M counts the recalls, B×P; 0 where no query is sought."""
        recalls: NDArray[np.float64] = self.chosen(weights)[2] / np.maximum(weights @ self.sought, 1)[:, None]
        return recalls


def _draws(count: int, seed: int) -> Iterator[NDArray[np.int32]]:
    """Yields how often each query is in each of `_DRAWS` draws of stretches, some draws at a time."""
    stretch = math.isqrt(count)
    rng = np.random.default_rng(seed)
    starts = rng.integers(0, count, (_DRAWS, round(count / stretch)))
    rows = max(1, _BLOCK // count)
    for first in range(0, _DRAWS, rows):
        some = starts[first : first + rows]
        width = count + stretch
        at = some + width * np.arange(len(some))[:, None]
        changes = [np.bincount(place.ravel(), minlength=width * len(some)) for place in (at, at + stretch)]
        # A stretch that begins in the last column ends in the first one of the next row, which is cut off below.
        steps = (changes[0] - changes[1][: width * len(some)]).reshape(len(some), width)
        counts = np.cumsum(steps, axis=1, dtype=np.int32)
        counts[:, :stretch] += counts[:, count:]  # around the end of the drive
        yield counts[:, :count]


def _plain(threshold: Any) -> float | None:
    """A threshold that JSON can hold; an infinite one accepts all there is."""
    return float(threshold) if np.isfinite(threshold) else None
