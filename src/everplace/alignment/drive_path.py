"""The path of one drive through another, found in their similarity alone.

Two drives along one route leave a line in their similarity matrix that only rises: it is found by dynamic
programming as the best local alignment (Smith and Waterman, "Identification of common molecular subsequences",
J. Mol. Biol. 1981), so both ends of both drives are free, with the symmetric step weights of dynamic time
warping (Sakoe and Chiba, IEEE Trans. ASSP 1978), so a drive may be slower than the other or wait.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.importing.positions.shared_places import Assignment, best_chain
from everplace.match.similarity import similarity

__all__ = ["Contrast", "Thinned", "best_pairs", "contrast", "find_path", "local_path", "thin", "thinning"]

_MOST_FRAMES = 2048
"""A drive with more frames is first searched in every so many-th frame; 2,048 × 2,048 scores are 16 MiB."""

_MARGIN = 1.0
"""Standard deviations by which a score must rise above the others before it speaks for the path."""

_STEP_COST = 0.5
"""What a step that moves in one drive only costs, in standard deviations."""

_ROWS = 256

_START, _DIAGONAL, _DOWN, _RIGHT = range(4)


@dataclass(frozen=True, eq=False)
class Thinned:
    """At most 2,048 frames of a drive, to look at it as a whole.

    Attributes:
        descriptors: Of every `stride`-th frame.
        stride: 1 where the drive is short.
    """

    descriptors: Descriptors
    stride: int


def thinning(frames: int) -> int:
    """Returns the stride at which a drive of so many frames is looked at as a whole."""
    return max(1, -(-frames // _MOST_FRAMES))


def thin(descriptors: Descriptors) -> Thinned:
    """Takes every so many-th frame of a drive."""
    stride = thinning(len(descriptors))
    return Thinned(descriptors.take(slice(None, None, stride)) if stride > 1 else descriptors, stride)


def find_path(first: Descriptors, second: Descriptors) -> Assignment:
    """Finds which frames of two drives show the same places.

    Long drives are searched twice: every so many-th frame, then all frames in a band around what was found.

    Args:
        first: M descriptors, in the order of travel.
        second: N descriptors of the same method.

    Returns:
        K indices into the first drive and K into the second; none where nothing looks alike.

    Raises:
        DescriptorsError: The descriptors are not of the same method and settings.
    """
    coarse = thin(first), thin(second)
    strides = coarse[0].stride, coarse[1].stride
    whole = contrast(similarity(coarse[0].descriptors, coarse[1].descriptors))
    pairs = best_pairs(whole.scores)
    if strides == (1, 1) or not len(pairs[0]):
        return pairs
    return _refine(first, second, (pairs[0] * strides[0], pairs[1] * strides[1]), whole, strides)


@dataclass(frozen=True, eq=False)
class Contrast:
    """A similarity matrix as it speaks for or against a path: `scores` and what they were made with.

    Attributes:
        scores: M×N, (S - row mean - column mean + mean) / deviation - margin.
        rows: M, row mean.
        columns: N, column mean less the mean of all.
        deviation: Of what is left when the means are gone.
    """

    scores: NDArray[np.float32]
    rows: NDArray[np.float64]
    columns: NDArray[np.float64]
    deviation: float


def contrast(S: NDArray[np.float32]) -> Contrast:
    """Takes from a similarity matrix what whole rows and columns have in common.

    A frame that looks like everything (a wall, a dark tunnel) and one that looks like nothing then count alike.
    """
    rows = S.mean(axis=1, dtype=np.float64)
    columns = S.mean(axis=0, dtype=np.float64) - float(S.mean(dtype=np.float64))
    scores = (S - rows[:, None] - columns).astype(np.float32)
    deviation = float(scores.std(dtype=np.float64)) or 1.0
    return Contrast(scores / np.float32(deviation) - np.float32(_MARGIN), rows, columns, deviation)


def best_pairs(scores: NDArray[np.float32]) -> Assignment:
    """Finds the best path in a whole matrix, without a row or column twice.

    Args:
        scores: M×N from `contrast`.

    Returns:
        K rows and K columns.
    """
    cells = local_path((0, row) for row in scores)
    return _one_to_one(cells, scores[cells])


def local_path(rows: Iterable[tuple[int, NDArray[np.floating]]]) -> Assignment:
    """Finds the best local alignment of a matrix given row by row, whole or along a band.

    A step down the diagonal counts the score of its cell twice, one along a side once, less a cost.

    Args:
        rows: For each row the column of its first cell, which never decreases, and the scores of its cells.
            Positive scores speak for a path, and the path ends where it would only lose.

    Returns:
        Row and column of each cell of the path, neither decreasing; none where no score is positive.
    """
    above, above_start = np.empty(0), 0
    steps: list[tuple[int, NDArray[np.uint8]]] = []
    best, end = 0.0, (-1, -1)
    for i, (start, cells) in enumerate(rows):
        scores = np.asarray(cells, np.float64)
        diagonal = np.maximum(_shifted(above, above_start, start - 1, len(scores)), 0.0)
        down = _shifted(above, above_start, start, len(scores)) + scores - _STEP_COST
        entered = diagonal + 2 * scores
        step = np.where(diagonal > 0, _DIAGONAL, _START).astype(np.uint8)
        step[down > entered] = _DOWN
        np.maximum(entered, down, out=entered)
        # Steps to the right are a recursion along the row, total[j] = max(entered[j], total[j-1] + gain[j]);
        # without the running sum of the gains it is a running maximum.
        gains = np.cumsum(scores - _STEP_COST)
        entered -= gains
        total = np.maximum.accumulate(entered)
        step[total > entered] = _RIGHT
        total += gains
        steps.append((start, step))
        if len(total) and total.max() > best:
            best, end = float(total.max()), (i, start + int(total.argmax()))
        above, above_start = total, start
    return _walk_back(steps, end)


def _refine(
    first: Descriptors, second: Descriptors, rough: Assignment, whole: Contrast, strides: tuple[int, int]
) -> Assignment:
    """Searches all frames in a band of two coarse steps around a rough path."""
    width = 2 * (strides[0] + strides[1])
    begin, end = max(0, int(rough[0][0]) - strides[0]), min(len(first), int(rough[0][-1]) + strides[0] + 1)
    middle = np.interp(np.arange(begin, end), rough[0], rough[1])
    lows = np.maximum(middle - width, 0).astype(np.int64)
    highs = np.minimum(middle + width + 1, len(second)).astype(np.int64)
    row_means = np.interp(np.arange(len(first)), np.arange(len(whole.rows)) * strides[0], whole.rows)
    column_means = np.interp(np.arange(len(second)), np.arange(len(whole.columns)) * strides[1], whole.columns)

    def band() -> Iterator[tuple[int, NDArray[np.floating]]]:
        for top in range(0, end - begin, _ROWS):
            block = slice(top, min(top + _ROWS, end - begin))
            left, right = int(lows[block][0]), int(highs[block][-1])
            frames = slice(begin + block.start, begin + block.stop)
            S = similarity(first.take(frames), second.take(slice(left, right)))
            scores = (S - row_means[frames, None] - column_means[left:right]) / whole.deviation - _MARGIN
            for row, low, high in zip(scores, lows[block].tolist(), highs[block].tolist(), strict=True):
                yield low, row[low - left : high - left]

    kept: list[tuple[int, NDArray[np.floating]]] = []

    def remembered() -> Iterator[tuple[int, NDArray[np.floating]]]:
        for start, row in band():
            kept.append((start, row.astype(np.float32)))
            yield start, row

    rows, columns = local_path(remembered())
    found = [kept[i][1][j - kept[i][0]] for i, j in zip(rows.tolist(), columns.tolist(), strict=True)]
    rows, columns = _one_to_one((rows, columns), np.array(found))
    return rows + begin, columns


def _one_to_one(cells: Assignment, scores: NDArray[np.floating]) -> Assignment:
    """Chooses from the cells of a path those with the best scores that use no row and no column twice."""
    if not len(cells[0]):
        return cells
    rows, columns = cells
    positive = np.asarray(scores, np.float64) - float(scores.min()) + 1.0
    bounds = np.searchsorted(rows, np.arange(rows[0], rows[-1] + 2))
    i, j = best_chain(
        int(columns[-1]) + 1,
        ((columns[a:b], positive[a:b]) for a, b in pairwise(bounds.tolist())),
    )
    return i + rows[0], j


def _shifted(row: NDArray[np.float64], start: int, at: int, length: int) -> NDArray[np.float64]:
    """Returns `length` entries from column `at` on of a row that begins at column `start`; -∞ outside."""
    result = np.full(length, -np.inf)
    low, high = max(start, at), min(start + len(row), at + length)
    if low < high:
        result[low - at : high - at] = row[low - start : high - start]
    return result


def _walk_back(steps: list[tuple[int, NDArray[np.uint8]]], end: tuple[int, int]) -> Assignment:
    i, j = end
    cells: list[tuple[int, int]] = []
    while i >= 0:
        cells.append((i, j))
        start, row = steps[i]
        step = row[j - start]
        if step == _START:
            break
        i, j = i - (step != _RIGHT), j - (step != _DOWN)
    path = np.array(cells[::-1], np.int64).reshape(-1, 2)
    return path[:, 0], path[:, 1]
