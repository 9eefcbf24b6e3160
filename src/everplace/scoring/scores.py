"""Scores of place recognition, each from its definition: curves, recall@N, average precision.

Every function takes the similarity matrix S (M×N, rows = queries, higher = more alike; infinity is a score,
NaN is not) and the truth (M×N bool, same place). Two views of the same matrix are scored, and a number means
nothing without its view:

- *best match*: each query proposes its best database frame, and the proposals above a threshold are accepted
  (`precision_recall`, `auc_pr`, `recall_at_100_precision`, `extended_precision`);
- *all pairs*: every (i, j) is a decision of its own (`average_precision`).

Ties: a query whose best score occurs twice proposes the lower database index, and recall@N ranks in that
order too; proposals (or pairs) with equal scores are accepted by the same threshold, so they enter a curve at
once. A query without a true match still proposes, wrongly, which costs precision; no recall counts it among
the sought.

Memory: S and truth are read in place, in blocks of rows; beside them stand the scores of the true pairs and a
few blocks of about `_BLOCK` elements.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import DescriptorsError, RouteError

__all__ = [
    "PrecisionRecall",
    "RecallAt",
    "Scores",
    "best_proposals",
    "evaluate",
    "precision_recall",
]

_BLOCK = 1 << 22  # matrix elements handled at once: 16 MiB of float32


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionRecall:
    """The best-match precision-recall curve: one point for each distinct best score.

    Attributes:
        recall: T values in [0, 1], not falling: correct proposals / queries that have a true match.
        precision: T values in [0, 1]: correct proposals / proposals.
        threshold: T distinct scores, falling; point t accepts the proposals that score at least threshold[t].
    """

    recall: NDArray[np.float64]
    precision: NDArray[np.float64]
    threshold: NDArray[Any]

    @property
    def area(self) -> float:
        """The area under it: trapezoids over recall, and the rectangle from recall 0 to the first point."""
        heights = (self.precision[1:] + self.precision[:-1]) / 2
        return float(self.recall[0] * self.precision[0] + np.sum(np.diff(self.recall) * heights))

    @property
    def recall_at_100_precision(self) -> float:
        """The largest recall that is reached without a wrong proposal; 0 if the best-scored one is wrong."""
        return float(self.recall[self.precision == 1.0].max(initial=0.0))

    @property
    def extended_precision(self) -> float:
        """The mean of the precision at the lowest recall and the recall at 100% precision, in [0, 1].

        EP = (P_R0 + R_P100) / 2 of Ferrarini et al., "Exploring Performance Bounds of Visual Place
        Recognition Using Extended Precision", IEEE RA-L 5(2), 2020. The lowest recall is that of the highest
        threshold.
        """
        return (float(self.precision[0]) + self.recall_at_100_precision) / 2


class RecallAt(dict[str, float]):
    """Recall by N; the keys are text, as in JSON, and a whole number finds them too: `recall_at[1]`."""

    def __getitem__(self, count: str | int) -> float:
        return super().__getitem__(str(count))

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Has pydantic read it back from JSON as what it is."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(cls, handler(dict[str, float]))


@dataclass(frozen=True, slots=True)
class Scores:
    """All scores of one query traverse against one database traverse; see the module for their definitions.

    Attributes:
        recall_at: For N = "1", "5", "10": of the queries that have a true match, the share for which one is
            among the N best database frames.
        auc_pr: Area under the best-match precision-recall curve.
        average_precision: Average precision over all pairs.
        recall_at_100_precision: Recall of the best-match curve before its first wrong proposal.
        extended_precision: Mean of the precision at the lowest recall and `recall_at_100_precision`.
        queries: Number of queries M.
        queries_with_match: Number of queries that have a true match, the denominator of every recall.
        database: Number of database frames N.
    """

    recall_at: RecallAt
    auc_pr: float
    average_precision: float
    recall_at_100_precision: float
    extended_precision: float
    queries: int
    queries_with_match: int
    database: int

    def __repr__(self) -> str:
        scores = ", ".join(f"{name} {score:.3f}" for name, score in self.columns().items())
        return f"Scores({scores}; {self.queries_with_match} of {self.queries} queries have a match)"

    def columns(self) -> dict[str, float]:
        """Returns the scores as the columns of a table, by their short names."""
        return {
            **{f"recall@{count}": recall for count, recall in self.recall_at.items()},
            "auc_pr": self.auc_pr,
            "AP": self.average_precision,
            "R@100%P": self.recall_at_100_precision,
            "EP": self.extended_precision,
        }

    def to_dict(self) -> dict[str, Any]:
        """Returns the scores as plain values that JSON can hold."""
        return dataclasses.asdict(self)


def evaluate(S: NDArray[Any], truth: NDArray[np.bool_]) -> Scores:
    """Scores a similarity matrix; for recall@N an N beyond the number of database frames counts as all of them.

    Args:
        S: M×N scores, rows = queries, higher = more alike.
        truth: M×N bool, True where query and database frame show the same place.

    Raises:
        DescriptorsError: S or truth is empty, not a matrix of numbers or bool, of another shape than the
            other, or S holds NaN.
        RouteError: No query has a true match.
    """
    S, truth = _checked(S, truth)
    curve = _curve(S, truth)
    return Scores(
        recall_at=_recall_at(S, truth),
        auc_pr=curve.area,
        average_precision=_average_precision(S, truth),
        recall_at_100_precision=curve.recall_at_100_precision,
        extended_precision=curve.extended_precision,
        queries=S.shape[0],
        queries_with_match=int(truth.any(axis=1).sum()),
        database=S.shape[1],
    )


def precision_recall(S: NDArray[Any], truth: NDArray[np.bool_]) -> PrecisionRecall:
    """Sweeps a threshold over the best match of every query; arguments and errors as for `evaluate`."""
    return _curve(*_checked(S, truth))


def best_proposals(
    S: NDArray[Any], truth: NDArray[np.bool_]
) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]]:
    """Finds the best match of every query; arguments and errors as for `evaluate`.

    Returns:
        (M,) each: its score, whether it is right, and whether the query has a true match at all.
    """
    return _proposals(*_checked(S, truth))


def _checked(S: NDArray[Any], truth: NDArray[np.bool_]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Returns both as arrays, S as floating point, or raises what is wrong with them."""
    S, truth = np.asarray(S), np.asarray(truth)
    if S.ndim != 2 or S.dtype.kind not in "fiu":
        raise DescriptorsError(f"the similarity matrix must be M×N numbers, not {S.dtype} of shape {S.shape}")
    if truth.shape != S.shape or truth.dtype != np.bool_:
        raise DescriptorsError(
            f"the truth must be bool of the shape {S.shape} of S, not {truth.dtype} of {truth.shape}"
        )
    if S.size == 0:
        raise DescriptorsError(f"the similarity matrix of shape {S.shape} is empty; choose at least one frame a side")
    S = S if S.dtype.kind == "f" else S.astype(np.float64)
    unordered = np.flatnonzero(np.isnan(S.min(axis=1)))  # min hands NaN on, and needs no M×N mask
    if unordered.size:
        query = int(unordered[0])
        column = int(np.flatnonzero(np.isnan(S[query]))[0])
        raise DescriptorsError(
            f"the similarity of query {query} and database frame {column} is NaN; describe these frames again"
        )
    if not truth.any():
        raise RouteError(
            f"none of the {S.shape[0]} queries has a true match in the database; "
            "choose traverses or frames that overlap, or a larger tolerance or radius"
        )
    return S, truth


def _row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yields slices of rows that together hold about `_BLOCK` elements each."""
    rows = max(1, _BLOCK // shape[1])
    for start in range(0, shape[0], rows):
        yield slice(start, start + rows)


def _proposals(S: NDArray[Any], truth: NDArray[np.bool_]) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_]]:
    queries = np.arange(S.shape[0])
    proposal = S.argmax(axis=1)  # the first of equals
    sought = np.asarray(truth.any(axis=1))
    return S[queries, proposal], truth[queries, proposal], sought


def _curve(S: NDArray[Any], truth: NDArray[np.bool_]) -> PrecisionRecall:
    score, right, sought = _proposals(S, truth)
    threshold, point = np.unique(score, return_inverse=True)
    accepted = np.cumsum(np.bincount(point)[::-1])
    correct = np.cumsum(np.bincount(point, weights=right.astype(np.float64))[::-1])
    return PrecisionRecall(correct / sought.sum(), correct / accepted, threshold[::-1])


def _recall_at(S: NDArray[Any], truth: NDArray[np.bool_]) -> RecallAt:
    ranks = np.concatenate([_true_ranks(S[rows], truth[rows]) for rows in _row_blocks(S.shape)])
    return RecallAt({str(count): float(np.mean(ranks < count)) for count in (1, 5, 10)})


def _true_ranks(S: NDArray[Any], truth: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns, for each query that has a true match, the rank (from 0) of its best-ranked one."""
    has_match = truth.any(axis=1)
    S, truth = S[has_match], truth[has_match]
    best = S.max(axis=1, where=truth, initial=-np.inf)[:, None]
    equal = best == S
    first = (equal & truth).argmax(axis=1)[:, None]
    ahead = (best < S) | (equal & (np.arange(S.shape[1]) < first))
    ranks: NDArray[np.int64] = ahead.sum(axis=1, dtype=np.int64)
    return ranks


def _average_precision(S: NDArray[Any], truth: NDArray[np.bool_]) -> float:
    """AP = Σ_t (R_t - R_{t-1}) P_t over the distinct scores t, as scikit-learn's `average_precision_score`.

    It does without sorted copies of all pairs: only a threshold at which a true pair enters adds to the sum, so it is
    enough to count, block by block, how many pairs score at least as high as each true one.
    """
    threshold, true_pairs = np.unique(S[truth], return_counts=True)
    accepted = np.zeros(len(threshold), np.int64)
    for rows in _row_blocks(S.shape):
        block = np.sort(S[rows], axis=None)
        accepted += block.size - np.searchsorted(block, threshold, side="left")
    correct = np.cumsum(true_pairs[::-1])[::-1]
    return float(np.sum(true_pairs * (correct / accepted)) / correct[0])
