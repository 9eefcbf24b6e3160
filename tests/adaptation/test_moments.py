"""Sums over vectors: against numpy's own statistics, and what adding them up must not change."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.adaptation.moments import Moments


def vectors(seed: int, count: int, features: int = 5) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    return (rng.normal(3.0, 2.0, (count, features)) * np.arange(1, features + 1)).astype(np.float32)


def assert_same(found: Moments, wanted: Moments) -> None:
    assert found.weight == pytest.approx(wanted.weight)
    np.testing.assert_allclose(found.total, wanted.total, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(found.products, wanted.products, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("count", [2, 1023, 1024, 2500])
def test_they_are_those_of_numpy(count: int) -> None:
    x, weights = vectors(1, count), np.random.default_rng(2).uniform(0, 2, count)
    found = Moments.of(x, weights)
    assert found.weight == pytest.approx(weights.sum())
    np.testing.assert_allclose(found.mean, np.average(x.astype(float), axis=0, weights=weights), rtol=1e-12)
    np.testing.assert_allclose(found.covariance(), np.cov(x.T.astype(float), aweights=weights, ddof=0), atol=1e-9)
    second = sum(w * np.outer(row, row) for w, row in zip(weights, x.astype(float), strict=True)) / weights.sum()
    np.testing.assert_allclose(found.second_moment(), second, rtol=1e-10)


def test_without_weights_every_vector_counts_once() -> None:
    x = vectors(3, 40)
    assert_same(Moments.of(x), Moments.of(x, np.ones(40)))
    np.testing.assert_allclose(Moments.of(x).covariance(), np.cov(x.T.astype(float), ddof=0), atol=1e-9)


@given(seed=st.integers(0, 2**31), cuts=st.lists(st.integers(0, 30), max_size=4), order=st.randoms())
@settings(max_examples=40, deadline=None)
def test_those_of_parts_add_up_in_any_order(seed: int, cuts: list[int], order: object) -> None:
    x, weights = vectors(seed, 30), np.random.default_rng(seed).uniform(0, 1, 30)
    parts = list(zip(np.split(x, sorted(cuts)), np.split(weights, sorted(cuts)), strict=True))
    order.shuffle(parts)  # type: ignore[attr-defined]
    total = Moments.none(5)
    for rows, own in parts:
        total += Moments.of(rows, own)
    assert_same(total, Moments.of(x, weights))


@given(seed=st.integers(0, 2**31), gone=st.integers(0, 3))
@settings(max_examples=20, deadline=None)
def test_a_drive_is_removed_by_adding_up_the_others(seed: int, gone: int) -> None:
    drives = [vectors(seed + number, 7 + number) for number in range(4)]
    kept = [drive for number, drive in enumerate(drives) if number != gone]
    found = Moments.none(5)
    for drive in kept:
        found += Moments.of(drive)
    assert_same(found, Moments.of(np.concatenate(kept)))


def test_a_weight_is_as_many_copies() -> None:
    x = vectors(4, 3)
    assert_same(Moments.of(x, np.array([1.0, 3.0, 0.0])), Moments.of(x[[0, 1, 1, 1]]))


def test_no_vector_has_zeros() -> None:
    none = Moments.none(4)
    assert none.features == 4
    for value in (none.mean, none.second_moment(), none.covariance(), Moments.of(np.empty((0, 4))).products):
        assert (value == 0).all()


def test_a_large_mean_does_not_drown_a_small_variance() -> None:
    rng = np.random.default_rng(5)
    x = (1000 + 0.1 * rng.normal(size=(5000, 2))).astype(np.float32)
    np.testing.assert_allclose(Moments.of(x).covariance(), np.cov(x.T.astype(float), ddof=0), atol=1e-7)
