"""Rows that are equal, and scores that must be equal because of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors, Metric
from everplace.match import similarity as module
from everplace.match.equal_rows import EqualRows
from everplace.match.matching import Matching, best_matches, compare_descriptors
from everplace.match.similarity import similarity, similarity_blocks, top_k

METRICS: tuple[Metric, ...] = ("cosine", "mean-absolute-difference", "place-posterior")


@settings(max_examples=60, deadline=None)
@given(arrays(np.float32, (9, 2), elements=st.sampled_from([-1.0, -0.0, 0.0, 2.0])))
def test_equal_rows_are_found_as_by_comparing_all(values: NDArray[np.float32]) -> None:
    rows = EqualRows(values)
    first = [next(j for j in range(9) if values[j].tolist() == one) for one in values.tolist()]
    assert rows.first.tolist() == first
    assert rows.distinct.tolist() == sorted(set(first))
    assert len(rows) == len(set(first))
    assert rows.distinct[rows.member].tolist() == first
    assert rows.repeated.tolist() == [first.count(one) > 1 for one in first]
    assert [one.tolist() for one in rows.members] == [
        [j for j in range(9) if first[j] == one] for one in sorted(set(first))
    ]


def stopping(count: int, metric: Metric, seed: int, dimension: int = 97) -> tuple[Descriptors, NDArray[np.int64]]:
    """A drive of which every frame shows one of a few views, and which view that is."""
    random = np.random.default_rng(seed)
    shown = random.integers(0, count // 5, count)
    values = random.standard_normal((count // 5, dimension)).astype(np.float32)[shown]
    return Descriptors(values, tuple(f"{i:04}" for i in range(count)), "test", metric), shown


@pytest.mark.parametrize("count", [57, 131, 203])
@pytest.mark.parametrize("metric", METRICS)
def test_equal_descriptors_have_equal_scores_in_whatever_blocks(metric: Metric, count: int) -> None:
    (query, asked), (database, shown) = stopping(count - 6, metric, 1), stopping(count, metric, 2)
    for block in (1, 7, 64, 1024):
        S = np.vstack([part for _, part in similarity_blocks(query, database, block)])
        for view in np.unique(shown):
            columns = S[:, shown == view]
            assert (columns == columns[:, :1]).all(), (block, view)
        for view in np.unique(asked):
            rows = S[asked == view]
            assert (rows == rows[:1]).all(), (block, view)


@pytest.mark.parametrize("k", [1, 3, 40, 500])
@pytest.mark.parametrize("metric", METRICS)
def test_of_equal_scores_the_lower_index_comes_first(metric: Metric, k: int, monkeypatch: pytest.MonkeyPatch) -> None:
    (query, asked), (database, shown) = stopping(61, metric, 3), stopping(209, metric, 4)
    monkeypatch.setattr(module, "_BLOCK", 16)
    monkeypatch.setattr(module, "_DATABASE_BLOCK", 11)
    indices, scores = top_k(query, database, k)
    assert indices.shape == (61, min(k, 209))
    S = similarity(query, database)
    np.testing.assert_allclose(scores, np.take_along_axis(S, indices, 1), rtol=1e-4, atol=1e-5)
    falls = np.diff(scores) < 0
    assert (falls | ((np.diff(scores) == 0) & (np.diff(indices) > 0))).all()
    for row in indices.tolist():
        for view in np.unique(shown[row]):
            found = [column for column in row if shown[column] == view]
            assert found == np.flatnonzero(shown == view)[: len(found)].tolist()
    for view in np.unique(asked):
        assert (indices[asked == view] == indices[asked == view][0]).all()


@pytest.mark.parametrize("how", ["centre", "full"])
@pytest.mark.parametrize("count", [57, 203])
def test_a_stop_stays_a_tie_when_drives_are_standardised(how: str, count: int) -> None:
    query, _ = stopping(31, "cosine", 5)
    database, shown = stopping(count, "cosine", 6)
    matching = Matching(standardise=how)  # type: ignore[arg-type]
    best = compare_descriptors(query, database, matching).argmax(axis=1)
    first = [int(np.flatnonzero(shown == shown[place])[0]) for place in best]
    assert best.tolist() == first
    assert best_matches(query, database, 1, matching)[0][:, 0].tolist() == first


def test_zero_and_scaled_descriptors_are_ties_too() -> None:
    """What has one direction is equal to the cosine, whatever its length; twice is exact in floating point."""
    query, _ = stopping(30, "cosine", 7)
    database, _ = stopping(60, "cosine", 8)
    values = np.vstack([database.values, 2 * database.values, np.zeros((3, 97), np.float32)])
    longer = replace(database, values=values, names=tuple(map(str, range(123))))
    S = similarity(query, longer)
    assert (S[:, :60] == S[:, 60:120]).all()
    assert (S[:, 120:] == 0).all()


def test_the_posterior_of_equal_places_is_that_of_all_of_them() -> None:
    query, _ = stopping(20, "place-posterior", 9, dimension=21)
    database, _ = stopping(40, "place-posterior", 10, dimension=21)
    S = similarity(query, database)
    x = query.values[:, 10:20].astype(np.float64) @ database.values[:, :10].T.astype(np.float64)
    new = query.values[:, 20:].astype(np.float64)
    expected = x - np.log(np.exp(x).sum(1, keepdims=True) + np.exp(new))
    np.testing.assert_allclose(S, expected, rtol=1e-4, atol=1e-5)
