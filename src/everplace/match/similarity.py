"""Similarity of descriptors, whole, in blocks, or only the best K; higher always means more alike.

Equal descriptors get equal scores. A matrix product does not promise that: it rounds equal columns differently by
where they stand. So each distinct descriptor of the database is compared once, and equal queries in one way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, DescriptorsError
from everplace.fabmap.place_posterior import PlacePosterior
from everplace.files import readable, shortened
from everplace.match.equal_rows import EqualRows

__all__ = ["best_columns", "directions", "similarity", "similarity_blocks", "top_k"]

_BLOCK = 1024
_DATABASE_BLOCK = 8192
_INDEX = (1 << 32) - 1


def similarity(query: Descriptors, database: Descriptors) -> NDArray[np.float32]:
    """Compares every query with every database frame.

    Cosine, Eq. 6 of the paper: q·d / (|q| |d|), in [-1, 1]; a zero vector is like nothing, 0.
    Mean absolute difference: -Σ|q - d| / D, at most 0.
    Place posterior (FAB-MAP): the logarithm of the probability of the place given the query, over all places of the
    database and a new one, at most 0; see `everplace.fabmap.place_posterior`.

    Args:
        query: M descriptors, the rows.
        database: N descriptors of the same method and settings, the columns.

    Returns:
        M×N scores, never NaN.

    Raises:
        DescriptorsError: The two do not come from the same method, settings and dimension.
    """
    S = np.empty((len(query), len(database)), np.float32)
    for rows, block in similarity_blocks(query, database):
        S[rows] = block
    return S


def similarity_blocks(
    query: Descriptors, database: Descriptors, block: int = _BLOCK
) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Compares as `similarity` does, without the whole matrix.

    Args:
        query: M descriptors.
        database: N descriptors of the same method and settings.
        block: Queries compared at once, at least 1.

    Yields:
        The rows of some queries, in order, and their B×N scores against the whole database.

    Raises:
        ConfigError: `block` is below 1.
        DescriptorsError: As for `similarity`.
    """
    if block < 1:
        raise ConfigError(f"blocks of {block} queries are not possible; give at least 1")
    comparison = _Comparison(query, database)
    asked, places = EqualRows(query.values), slice(0, len(comparison.places))
    for start in range(0, len(query), block):
        rows = slice(start, min(start + block, len(query)))
        S = comparison(rows, places)
        first = asked.first[rows]
        for one in np.unique(first[asked.repeated[rows]]).tolist():  # alone, so that no block decides how it is rounded
            S[first == one] = comparison(slice(one, one + 1), places)
        yield rows, S if len(places_of := comparison.places) == len(database) else S[:, places_of.member]


def top_k(query: Descriptors, database: Descriptors, k: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Finds the K most similar database frames of every query by comparing all, without the M×N matrix.

    Args:
        query: M descriptors.
        database: N descriptors of the same method and settings.
        k: K, at least 1; more than N gives N.

    Returns:
        Indices M×K into the database and their scores M×K, best first; of equal scores the lower index first.

    Raises:
        ConfigError: K is below 1.
        DescriptorsError: As for `similarity`.
    """
    _require_some(k)
    asked = EqualRows(query.values)
    if len(asked) < len(query):
        names = tuple(query.names[row] for row in asked.distinct)
        once = replace(query, values=query.values[asked.distinct], names=names, image_names=None)
        indices, scores = top_k(once, database, k)
        return indices[asked.member], scores[asked.member]
    comparison = _Comparison(query, database)
    places = comparison.places
    k = min(k, len(database))
    indices = np.empty((len(query), k), np.int64)
    scores = np.empty((len(query), k), np.float32)
    for first in range(0, len(query), _BLOCK):
        rows = slice(first, min(first + _BLOCK, len(query)))
        best = np.empty((rows.stop - rows.start, 0), np.int64)
        for start in range(0, len(places), _DATABASE_BLOCK):
            columns = slice(start, min(start + _DATABASE_BLOCK, len(places)))
            keys = _ranking_keys(comparison(rows, columns), places.distinct[columns])
            best = _largest(np.hstack([best, keys]), k)
        if len(places) < len(database):
            best = np.stack([_with_equal_places(keys, places, k) for keys in best])
        best = np.sort(best, axis=1)[:, ::-1]
        indices[rows] = _columns_of(best)
        scores[rows] = _ordered_bits((best >> 32).astype(np.int32)).view(np.float32)
    return indices, scores


def best_columns(S: NDArray[np.floating[Any]], k: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Finds the K highest scores of every row.

    Args:
        S: M×N scores; NaN is the lowest.
        k: K, at least 1; more than N gives N.

    Returns:
        Columns M×K and their scores M×K, best first; of equal scores the lower column first.

    Raises:
        ConfigError: K is below 1.
    """
    _require_some(k)
    k = min(k, S.shape[1])
    columns = np.empty((len(S), k), np.int64)
    every = np.arange(S.shape[1], dtype=np.int64)
    for first in range(0, len(S), _BLOCK):
        rows = slice(first, min(first + _BLOCK, len(S)))
        block = np.where(np.isnan(S[rows]), -np.inf, S[rows]).astype(np.float32, copy=False)
        columns[rows] = _columns_of(np.sort(_largest(_ranking_keys(block, every), k), axis=1)[:, ::-1])
    return columns, np.take_along_axis(S, columns, axis=1).astype(np.float32, copy=False)


def _require_some(k: int) -> None:
    if k < 1:
        raise ConfigError(f"the best {k} matches were asked for (`k`); give at least 1")


def _columns_of(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return _INDEX - (keys & _INDEX)


def _with_equal_places(keys: NDArray[np.int64], places: EqualRows, k: int) -> NDArray[np.int64]:
    """The K largest keys, once each key of a distinct place also stands for the places that are equal to it."""
    equal = [places.members[place][:k] for place in places.member[_columns_of(keys)]]
    scores = np.repeat(keys & ~_INDEX, [len(some) for some in equal])
    largest: NDArray[np.int64] = np.sort(scores | (_INDEX - np.concatenate(equal)))[-k:]
    return largest


def _ranking_keys(S: NDArray[np.float32], columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Packs score and column into one integer that sorts as (score, lower index first)."""
    bits = _ordered_bits((S + np.float32(0)).view(np.int32))  # + 0 makes -0 and 0 equal
    keys: NDArray[np.int64] = (bits.astype(np.int64) << 32) | (_INDEX - columns)
    return keys


def _ordered_bits(bits: NDArray[np.int32]) -> NDArray[np.int32]:
    """Maps the bits of float32 to integers of the same order, and back: negative floats count downwards."""
    return bits ^ ((bits >> 31) & np.int32(0x7FFFFFFF))


def _largest(keys: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    surplus = keys.shape[1] - k
    return keys if surplus <= 0 else np.partition(keys, surplus, axis=1)[:, surplus:]


class _Comparison:
    """Compares some queries with some of the distinct descriptors of a database.

    Attributes:
        places: Which rows of the database are distinct.
    """

    def __init__(self, query: Descriptors, database: Descriptors) -> None:
        """Raises a DescriptorsError where the two do not come from the same method, settings and dimension."""
        _require_comparable(query, database)
        self._metric = query.metric
        self._query, values = query.values, database.values
        if self._metric == "cosine":
            self._query, values = directions(self._query), directions(values)
        self.places = EqualRows(values)
        self._places = values if len(self.places) == len(values) else values[self.places.distinct]
        if self._metric == "place-posterior":
            self._posterior = PlacePosterior(self._query, self._places, self.places.counts)

    def __call__(self, rows: slice, places: slice) -> NDArray[np.float32]:
        """Scores of these queries, by distinct place."""
        if self._metric == "cosine":
            return _cosine(self._query[rows], self._places[places])
        if self._metric == "place-posterior":
            return self._posterior.log_probability(rows, places)
        return 0 - _mean_absolute_difference(self._query[rows], self._places[places])


def _require_comparable(query: Descriptors, database: Descriptors) -> None:
    for what in ("method", "metric", "dimension"):
        _require_equal(what, getattr(query, what), getattr(database, what), query, database)
    for name in sorted({*query.settings, *database.settings}):
        ours, theirs = query.settings.get(name, "not set"), database.settings.get(name, "not set")
        _require_equal(f"setting {shortened(readable(name))}", ours, theirs, query, database)


def _require_equal(what: str, ours: object, theirs: object, query: Descriptors, database: Descriptors) -> None:
    if ours != theirs:
        asked, known = ("" if of.path is None else f" {readable(of.path)}" for of in (query, database))
        first, second = (shortened(readable(str(value))) for value in (ours, theirs))
        raise DescriptorsError(
            f"the {what} of the query{asked} is {first} and of the database{known} {second}; describe both alike"
        )


def directions(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Divides every row by its length; a zero row stays zero."""
    # Lengths in double precision: the square of a large or tiny float32 is no float32.
    # Block by block and row by row: how a row is rounded may not depend on where it stands.
    squares = np.empty(len(values))
    for start in range(0, len(values), _BLOCK):
        squares[start : start + _BLOCK] = np.square(values[start : start + _BLOCK], dtype=np.float64).sum(axis=1)
    inverse = np.divide(1.0, np.sqrt(squares), out=np.zeros_like(squares), where=squares > 0)
    divided = np.empty_like(values)
    np.multiply(values, inverse[:, None], out=divided, casting="same_kind")
    return divided


def _cosine(query: NDArray[np.float32], database: NDArray[np.float32]) -> NDArray[np.float32]:
    """Multiplies directions; rounding may not lead out of [-1, 1]."""
    S = query @ database.T
    return np.clip(S, -1, 1, out=S)


def _mean_absolute_difference(query: NDArray[np.float32], database: NDArray[np.float32]) -> NDArray[np.float32]:
    """Compares pair by pair, so that no score depends on what else is compared."""
    import faiss

    differences: NDArray[np.float32] = faiss.pairwise_distances(
        np.ascontiguousarray(query), np.ascontiguousarray(database), metric=faiss.METRIC_L1
    )
    return np.divide(differences, np.float32(query.shape[1]), out=differences)
