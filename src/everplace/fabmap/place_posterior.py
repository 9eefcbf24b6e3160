"""FAB-MAP's posterior: the probability of each place of a database, and of a new place, given a query.

The descriptors are those of `everplace.fabmap.fabmap_model.FabMap.embed`. With x_j = log p(Z|L_j) and x_0 = log p(Z|new
place), both less the same constant of the query, and all of them equally likely beforehand,

    p(L_j | Z) = exp(x_j) / (exp(x_0) + Σ_k exp(x_k)).

Everything is a logarithm: probabilities themselves would be 0 or 1 for most pairs, and order nothing.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from everplace.errors import DescriptorsError

__all__ = ["PlacePosterior"]

_BLOCK = 1024
_DATABASE_BLOCK = 8192


class PlacePosterior:
    """The posterior over the places of a database, for M queries and N places.

    Args:
        query: M×(2W + 1) descriptors; only their part as observations is used.
        database: N×(2W + 1) descriptors; only their part as places is used.
        counts: (N,) how many places of the database each of them stands for; None: one.

    Raises:
        DescriptorsError: The descriptors are not FAB-MAP's.
    """

    def __init__(
        self, query: NDArray[np.float32], database: NDArray[np.float32], counts: NDArray[np.int64] | None = None
    ) -> None:
        words, odd = divmod(query.shape[1], 2)
        if not odd or not words or database.shape[1] != query.shape[1]:
            raise DescriptorsError(
                f"descriptors of {query.shape[1]} and {database.shape[1]} numbers are no words of FAB-MAP; describe "
                "both with one run of fabmap"
            )
        self._coefficients = query[:, words : 2 * words]
        self._new_place = query[:, 2 * words]
        self._places = database[:, :words]
        self._counts = np.ones(len(database), np.int64) if counts is None else counts
        self._known: tuple[slice, NDArray[np.float32], NDArray[np.float64]] | None = None

    def log_probability(self, rows: slice, columns: slice) -> NDArray[np.float32]:
        """Log p(L_j|Z_i), at most 0, for some queries and places, normalised over all places and the new one."""
        x = self._log_likelihood(rows, columns)
        whole = x.shape[1] == len(self._places)
        top, others = self._normaliser(rows, [x]) if whole else self._remembered_normaliser(rows)
        x -= top[:, None]
        x -= np.log1p(others).astype(np.float32)[:, None]
        return np.minimum(x, 0.0, out=x)

    def log_new_place(self) -> NDArray[np.float32]:
        """Log p(new place|Z) of each query, (M,), at most 0."""
        posterior = np.empty(len(self._new_place), np.float32)
        for start in range(0, len(posterior), _BLOCK):
            rows = slice(start, min(start + _BLOCK, len(posterior)))
            top, others = self._remembered_normaliser(rows)
            posterior[rows] = self._new_place[rows] - top - np.log1p(others)
        return np.minimum(posterior, 0.0)

    def _log_likelihood(self, rows: slice, columns: slice) -> NDArray[np.float32]:
        """All observations against all places in one product, less log p(Z|a place without words)."""
        product: NDArray[np.float32] = self._coefficients[rows] @ self._places[columns].T
        return product

    def _remembered_normaliser(self, rows: slice) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """The normaliser of these queries, kept while the places come block by block."""
        if self._known is None or self._known[0] != rows:
            starts = range(0, len(self._places), _DATABASE_BLOCK)
            blocks = (self._log_likelihood(rows, slice(start, start + _DATABASE_BLOCK)) for start in starts)
            self._known = (rows, *self._normaliser(rows, blocks))
        return self._known[1:]

    def _normaliser(
        self, rows: slice, blocks: Iterable[NDArray[np.float32]]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """The largest log-likelihood of each query, and the sum of exp(all others less that one).

        The largest is kept apart because beside its 1 small sums would be lost, and a sure match would tie with a
        surer one.
        """
        top = self._new_place[rows].copy()
        others = np.zeros(len(top))
        start = 0
        for x in blocks:
            counts = self._counts[start : start + x.shape[1]].astype(np.float32)
            start += x.shape[1]
            best = x.argmax(axis=1)[:, None]
            highest = np.take_along_axis(x, best, axis=1)[:, 0]
            share = np.exp(x - highest[:, None]) * counts
            np.put_along_axis(share, best, counts[best] - 1, axis=1)
            rest = share.sum(axis=1, dtype=np.float64)
            higher, lower = np.maximum(top, highest), np.minimum(top, highest)
            of_higher, of_lower = np.where(highest > top, (rest, others), (others, rest))
            others = of_higher + (1.0 + of_lower) * np.exp(lower.astype(np.float64) - higher)
            top = higher
        return top, others
