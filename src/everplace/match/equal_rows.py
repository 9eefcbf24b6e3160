"""Which rows of a matrix are equal."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["EqualRows"]

_ROWS = 1024


class EqualRows:
    """The distinct rows of a matrix, in the order in which they first occur; its length is their number.

    Attributes:
        first: (N,) for every row the lowest index of a row that is equal to it; 0 and -0 are equal.
    """

    def __init__(self, values: NDArray[np.float32]) -> None:
        """Looks at N×D values, of which none is NaN."""
        first = np.arange(len(values))
        # Rows are told apart by a weighted sum of their bits, and rows of equal sums are compared.
        _, lowest, group = np.unique(_bit_sums(values), return_index=True, return_inverse=True)
        if len(lowest) < len(values):
            candidate = lowest[group]
            for row in np.flatnonzero(candidate != first):
                if np.array_equal(values[row], values[candidate[row]]):
                    first[row] = candidate[row]
        self.first: NDArray[np.int64] = first

    def __len__(self) -> int:
        return len(self.distinct)

    @cached_property
    def distinct(self) -> NDArray[np.int64]:
        """(P,) indices of the distinct rows, rising."""
        return np.flatnonzero(self.first == np.arange(len(self.first)))

    @cached_property
    def member(self) -> NDArray[np.int64]:
        """(N,) which distinct row, from 0 to P - 1, each row is equal to."""
        return np.searchsorted(self.distinct, self.first)

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """(P,) how often each distinct row occurs."""
        return np.bincount(self.member, minlength=len(self))

    @cached_property
    def members(self) -> list[NDArray[np.int64]]:
        """For each distinct row the rows that are equal to it, itself included, rising."""
        return np.split(np.argsort(self.member, kind="stable"), np.cumsum(self.counts)[:-1])

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """(N,) whether there is another row that is equal."""
        repeated: NDArray[np.bool_] = self.counts[self.member] > 1
        return repeated


def _bit_sums(values: NDArray[np.float32]) -> NDArray[np.uint64]:
    weights = np.random.default_rng(0).integers(0, 1 << 63, values.shape[1], np.uint64) * np.uint64(2) + np.uint64(1)
    sums = np.empty(len(values), np.uint64)
    for start in range(0, len(values), _ROWS):
        rows = np.ascontiguousarray(values[start : start + _ROWS]) + np.float32(0)  # makes -0 and 0 equal
        sums[start : start + _ROWS] = rows.view(np.uint32) @ weights
    return sums
