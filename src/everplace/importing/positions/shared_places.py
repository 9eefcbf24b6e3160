"""Which frames of several drives show the same place: by position, by a few pairs set by hand, or along a band.

All of it works on indices of frames. What comes out is always a one-to-one assignment in which both sides
increase: no frame is used twice, and the order of travel is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError

__all__ = [
    "Assignment",
    "align_all_by_pairs",
    "align_all_by_position",
    "align_by_pairs",
    "align_by_position",
    "align_drives",
    "best_chain",
    "sparsest",
]

Assignment = tuple[NDArray[np.int64], NDArray[np.int64]]
"""K indices into one drive and K into another; both increase strictly."""

_ROWS = 1024
_COMPACT_ABOVE = 1 << 20


def align_drives(
    counts: Mapping[str, int], reference: str, align: Callable[[str, NDArray[np.int64]], Assignment]
) -> dict[str, NDArray[np.int64]]:
    """Finds the places that all drives have.

    One drive after the other is aligned with those frames of the reference that all drives before it have, so
    that drives that are sparser than the reference do not miss each other.

    Args:
        counts: Number of frames of each drive, by name.
        reference: The drive that the others are aligned with.
        align: Given another drive and K frames of the reference, returns which of these K (indices into the K)
            show the same places as which frames of the other drive.

    Returns:
        For each drive the frames of the P places, increasing.
    """
    found = {reference: np.arange(counts[reference], dtype=np.int64)}
    for name in counts:
        if name != reference:
            kept, partners = align(name, found[reference])
            found = {other: frames[kept] for other, frames in found.items()}
            found[name] = partners
    return {name: found[name] for name in counts}


def align_all_by_position(
    positions: Mapping[str, NDArray[np.float64]], reference: str, radius: float
) -> dict[str, NDArray[np.int64]]:
    """Finds the places of drives whose positions are known; see `align_drives` and `align_by_position`."""
    counts = {name: len(frames) for name, frames in positions.items()}
    return align_drives(
        counts,
        reference,
        lambda name, places: align_by_position(positions[reference][places], positions[name], radius),
    )


def align_all_by_pairs(
    counts: Mapping[str, int], reference: str, pairs: Mapping[str, NDArray[np.int64]]
) -> dict[str, NDArray[np.int64]]:
    """Finds the places of drives for which pairs were set; see `align_drives` and `align_by_pairs`."""
    return align_drives(counts, reference, lambda name, places: align_by_pairs(pairs[name], places))


def sparsest(counts: Mapping[str, int]) -> str:
    """Returns the drive with the fewest frames, or the first of them: each of its frames can have a partner."""
    return min(counts, key=lambda name: counts[name])


def align_by_position(a: NDArray[np.float64], b: NDArray[np.float64], radius: float) -> Assignment:
    """Assigns the frames of two drives to each other by where they were taken.

    Of all monotone one-to-one assignments whose pairs are at most `radius` apart, it is the one with the largest
    sum of (1 - distance / radius)². So a frame goes to the nearest frame of the other drive, unless the order
    of travel, which tells two passes through one street apart, forbids it.

    Args:
        a: M×2, x and y in metres.
        b: N×2, in the same plane.
        radius: Metres up to which two frames show the same place, exclusive.

    Returns:
        Indices into `a` and `b`.

    Raises:
        ConfigError: The radius is not a positive number.
    """
    from scipy.spatial import KDTree

    if not (np.isfinite(radius) and radius > 0):
        raise ConfigError(f"`radius` {radius} is not a positive number of metres; give one")
    tree = KDTree(b)

    def rows() -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        for start in range(0, len(a), _ROWS):
            block = a[start : start + _ROWS]
            for position, near in zip(block, tree.query_ball_point(block, radius, return_sorted=True), strict=True):
                cells = np.asarray(near, np.int64)
                closeness = 1.0 - np.linalg.norm(b[cells] - position, axis=1) / radius
                inside = closeness > 0
                yield cells[inside], np.square(closeness[inside])

    return best_chain(len(b), rows())


def align_by_pairs(pairs: NDArray[np.int64], places: NDArray[np.int64]) -> Assignment:
    """Assigns frames by pairs set by hand, linearly between one pair and the next.

    Before the first pair and behind the last nothing is assigned. Where several frames fall on the same frame of
    the other drive, the one that falls on it most exactly is kept.

    Args:
        pairs: K×2 indices of frames that show the same place; both columns increase strictly, K is at least 2.
        places: The frames of the first drive to assign, increasing.

    Returns:
        Indices into `places` and into the second drive.
    """
    inside = np.flatnonzero((places >= pairs[0, 0]) & (places <= pairs[-1, 0]))
    exact = np.interp(places[inside], pairs[:, 0], pairs[:, 1])
    nearest = np.floor(exact + 0.5).astype(np.int64)
    order = np.lexsort((np.abs(exact - nearest), nearest))
    _, first = np.unique(nearest[order], return_index=True)
    chosen = np.sort(order[first])
    return inside[chosen], nearest[chosen]


def best_chain(columns: int, rows: Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]) -> Assignment:
    """Finds the chain of cells (i, j), both increasing strictly, with the largest sum of scores.

    Dynamic programming over the rows: `best[j]` is the largest sum of a chain that ends at a column of at
    most j. Only the given cells are visited, so a band around a path costs as much as the band; memory holds one
    row, and the cells of the chains that can still win.

    Args:
        columns: N, the number of columns.
        rows: For each row the columns of its cells, ascending, and their positive scores.

    Returns:
        The row and the column of each cell of the chain.
    """
    best = np.zeros(columns + 1)  # best[j + 1] belongs to column j; best[0] is the empty chain
    last = np.full(columns + 1, -1, np.int64)
    chains = _Chains()
    for i, (cells, scores) in enumerate(rows):
        if not len(cells):
            continue
        sums = best[cells] + scores
        better = np.flatnonzero(sums > best[cells + 1])
        # In this row a cell matters only if no cell to its left gives as much.
        running = np.maximum.accumulate(sums[better])
        better = better[np.diff(running, prepend=-np.inf) > 0]
        if not len(better):
            continue
        nodes = chains.add(i, cells[better], last[cells[better]])
        _raise(best, last, cells[better] + 1, sums[better], nodes)
        if chains.size > chains.limit:
            last = chains.compact(last)
    return chains.back_from(int(last[-1]))


class _Chains:
    """Cells, each with the cell before it; forgets those that no chain leads to any more."""

    def __init__(self) -> None:
        self.limit = _COMPACT_ABOVE
        self.size = 0
        self._parts: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]] = []

    def add(self, row: int, columns: NDArray[np.int64], before: NDArray[np.int64]) -> NDArray[np.int64]:
        """Adds cells of one row and returns their numbers."""
        self._parts.append((np.full(len(columns), row, np.int64), columns, before))
        self.size += len(columns)
        return np.arange(self.size - len(columns), self.size, dtype=np.int64)

    def compact(self, last: NDArray[np.int64]) -> NDArray[np.int64]:
        """Keeps the cells of the chains that end at `last`, and returns the new numbers of these ends."""
        rows, columns, before = self._joined()
        alive = np.zeros(len(rows), np.bool_)
        front = np.unique(last[last >= 0])
        while len(front):
            alive[front] = True
            front = np.unique(before[front])
            front = front[front >= 0]
            front = front[~alive[front]]
        number = np.append(np.cumsum(alive) - 1, -1)  # the last entry is for the number -1, no cell
        self._parts = [(rows[alive], columns[alive], number[before[alive]])]
        self.size = int(alive.sum())
        self.limit = max(_COMPACT_ABOVE, 2 * self.size)
        return number[last]

    def back_from(self, node: int) -> Assignment:
        """Returns the rows and columns of the chain that ends at a cell."""
        rows, columns, before = self._joined()
        chain = []
        while node >= 0:
            chain.append(node)
            node = int(before[node])
        order = np.array(chain[::-1], np.int64)
        return rows[order], columns[order]

    def _joined(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        empty = np.empty(0, np.int64)
        columns = zip(*self._parts, strict=True) if self._parts else ((empty,), (empty,), (empty,))
        rows, cells, before = (np.concatenate(column) for column in columns)
        self._parts = [(rows, cells, before)]
        return rows, cells, before


def _raise(
    best: NDArray[np.float64],
    last: NDArray[np.int64],
    at: NDArray[np.int64],
    sums: NDArray[np.float64],
    nodes: NDArray[np.int64],
) -> None:
    """For each sum, sets best[j] = max(best[j], sum) for all j from its place on; both ascend.

    Args:
        best: Ascending, changed in place.
        last: The cells that `best` ends with, changed in place.
        at: Places, ascending strictly.
        sums: Ascending strictly.
        nodes: The cells to enter.
    """
    reach = np.searchsorted(best, sums, side="left")  # up to here `best` is less
    ends = np.minimum(reach, np.append(at[1:], len(best)))
    lengths = np.maximum(ends - at, 0)
    total = int(lengths.sum())
    which = np.repeat(np.arange(len(at)), lengths)
    where = np.arange(total) - np.repeat(np.cumsum(lengths) - lengths, lengths) + at[which]
    best[where] = sums[which]
    last[where] = nodes[which]
