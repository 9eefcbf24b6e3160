"""How sure a path of one drive through another is, however it was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.alignment.drive_path import Thinned, best_pairs, contrast
from everplace.importing.positions.shared_places import Assignment
from everplace.match.similarity import similarity

__all__ = ["JudgedPath", "crooked", "judge_path", "rivals"]

_SEQUENCE = 11
_APART = 10
_BETTER_THAN_CHANCE = 2.0
_CROOKED = 3.0


@dataclass(frozen=True, eq=False)
class JudgedPath:
    """The frames of two drives that a path joins, and how sure it is.

    Attributes:
        pairs: K indices into the first drive and K into the second; both increase strictly.
        unsure: K bool, where another stretch of the second drive looks as much like the first's, or where one drive
            moves and the other hardly does: it stood still, or the path is wrong.
        by_chance: Whether the whole path is hardly better than what is found in the second drive backwards, where
            there is none; then all of it is unsure.
        S: The similarity it was judged by: every `strides[0]`-th frame of the first drive against every
            `strides[1]`-th of the second.
        strides: See `S`; (1, 1) where both drives are short.
    """

    pairs: Assignment
    unsure: NDArray[np.bool_]
    by_chance: bool
    S: NDArray[np.float32]
    strides: tuple[int, int]


def judge_path(first: Thinned, second: Thinned, pairs: Assignment) -> JudgedPath:
    """Tells how sure a path is, however it was found.

    Args:
        first: The first drive.
        second: The second drive, described by the same method.
        pairs: The path, at least one pair of frames of the whole drives.

    Raises:
        DescriptorsError: The descriptors are not of the same method and settings.
    """
    S = similarity(first.descriptors, second.descriptors)
    scores = contrast(S).scores
    rows, kept, back = np.unique(pairs[0] // first.stride, return_index=True, return_inverse=True)
    seen = rows, pairs[1][kept] // second.stride
    backwards = np.ascontiguousarray(scores[:, ::-1])
    chance = float(backwards[best_pairs(backwards)].sum())
    by_chance = float(scores[seen].sum()) <= _BETTER_THAN_CHANCE * chance
    unsure = rivals(scores, seen) | crooked(seen) | by_chance
    return JudgedPath(pairs, unsure[back], by_chance, S, (first.stride, second.stride))


def rivals(scores: NDArray[np.float32], pairs: Assignment) -> NDArray[np.bool_]:
    """Tells where a path is unsure: a sequence of frames matches another stretch as well as its own.

    Around each pair the mean score of 11 pairs is compared with the same path shifted by 10 columns and more, as
    SeqSLAM judges its matches (Milford and Wyeth, ICRA 2012).

    Args:
        scores: M×N from `contrast`.
        pairs: The path, K pairs.

    Returns:
        K bool.
    """
    rows, columns = pairs
    K, N = len(rows), scores.shape[1]
    half = min(_SEQUENCE, K) // 2
    # Column N - 1 + d of `shifted` is the path shifted by d columns.
    shifted = np.full((K, 2 * N - 1), -np.inf, np.float32)
    for k, (i, j) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True)):
        shifted[k, N - 1 - j : 2 * N - 1 - j] = scores[i]
    unsure = np.zeros(K, np.bool_)
    for k in range(K):
        mean = shifted[max(0, k - half) : k + half + 1].mean(axis=0)
        own = mean[N - 1]
        mean[max(0, N - _APART) : N - 1 + _APART] = -np.inf
        unsure[k] = own <= max(float(mean.max()), 0.0)
    return unsure


def crooked(pairs: Assignment) -> NDArray[np.bool_]:
    """Marks pairs where one drive advances over three times, or under a third, as fast against the other as is usual.

    Args:
        pairs: The path, K pairs.

    Returns:
        K bool; of 11 pairs around each.
    """
    rows, columns = pairs
    k = np.arange(len(rows))
    low, high = np.maximum(k - _SEQUENCE // 2, 0), np.minimum(k + _SEQUENCE // 2, len(k) - 1)
    ways = (columns[high] - columns[low] + 1) / (rows[high] - rows[low] + 1)
    usual = float(np.median(ways))
    apart: NDArray[np.bool_] = np.abs(np.log(ways / usual)) > np.log(_CROOKED)
    return apart
