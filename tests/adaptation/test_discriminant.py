"""The place discriminant: its scatter against loops over pairs, its directions against what was put in."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from threadpoolctl import threadpool_info, threadpool_limits

from everplace.adaptation import discriminant
from everplace.adaptation.discriminant import PlaceScatter, add_ridge, leading_directions


def scatter_of(features: NDArray[np.float32], block: int = 1000) -> PlaceScatter:
    scatter = PlaceScatter(features.shape[0], features.shape[2])
    for start in range(0, features.shape[1], block):
        scatter.add(features[:, start : start + block])
    return scatter


@given(seed=st.integers(0, 2**31), traverses=st.integers(2, 4), places=st.integers(1, 9), block=st.integers(1, 9))
@settings(max_examples=30, deadline=None)
def test_scatter_is_that_of_all_ordered_pairs(seed: int, traverses: int, places: int, block: int) -> None:
    features = np.random.default_rng(seed).normal(1.0, 2.0, (traverses, places, 5)).astype(np.float32)
    scatter = scatter_of(features, block)
    centred = features.astype(float) - features.mean(axis=1, keepdims=True, dtype=float)
    pairs = list(permutations(range(traverses), 2))
    between = sum(centred[a].T @ centred[b] for a, b in pairs) / (len(pairs) * places)
    apart = [features[a].astype(float) - features[b] for a, b in pairs]
    within = sum(difference.T @ difference for difference in apart) / (2 * len(pairs) * places)
    assert scatter.between() == pytest.approx(between, abs=1e-4)
    assert scatter.within() == pytest.approx(within, abs=1e-4)


def drives(places: int, noise: float, seed: int = 0) -> NDArray[np.float32]:
    """Two drives: features 0 to 3 are the place's, 4 to 7 change from drive to drive, 8 is the condition."""
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(places, 4))
    features = np.empty((2, places, 9), np.float32)
    for traverse in range(2):
        features[traverse, :, :4] = place + noise * rng.normal(size=place.shape)
        features[traverse, :, 4:8] = 5.0 * rng.normal(size=place.shape)
        features[traverse, :, 8] = 10.0 * traverse + 0.1 * rng.normal(size=places)
    return features


def test_it_keeps_what_is_the_places_and_drops_what_is_the_conditions() -> None:
    projection = scatter_of(drives(4000, 0.1)).discriminant(4, 0.01)
    weight = projection.weight / np.linalg.norm(projection.weight, axis=1, keepdims=True)
    assert np.square(weight[:, :4]).sum(axis=1).min() > 0.99
    assert np.square(weight[:, 8]).max() < 1e-3


def test_its_output_is_centred_and_as_wide_as_a_standard_normal() -> None:
    features = drives(500, 0.3)
    projection = scatter_of(features, 64).discriminant(4, 1.0)
    z = features.reshape(-1, 9) @ projection.weight.T + projection.bias
    assert z.mean(axis=0) == pytest.approx(0.0, abs=1e-4)
    assert z.var(axis=0).mean() == pytest.approx(1.0, rel=1e-3)


def test_its_directions_are_white_within_places() -> None:
    scatter = scatter_of(drives(200, 0.5))
    within = scatter.within()
    weight = scatter.discriminant(3, 0.5).weight
    ridged = within + 0.5 * np.trace(within) / 9 * np.eye(9)
    white = weight @ ridged @ weight.T
    assert white / white[0, 0] == pytest.approx(np.eye(3), abs=1e-8)


def test_places_that_all_look_alike_give_numbers() -> None:
    projection = scatter_of(np.zeros((2, 5, 6), np.float32)).discriminant(3, 1.0)
    assert np.isfinite(projection.weight).all()
    assert np.isfinite(projection.bias).all()


def known_problem(features: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """B, W and the vectors of B v = λ W v with Vᵀ W V = 1, the strongest first: λ = F, F - 1, ..., 1."""
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(features, features)) + 3 * np.eye(features)
    vectors = np.asarray(np.linalg.inv(mixing).T, np.float64)
    values = np.arange(features, 0, -1.0)
    return (mixing.T * values) @ mixing, mixing.T @ mixing, vectors


@pytest.mark.parametrize("iterated", [False, True])
def test_leading_directions_of_a_known_problem(monkeypatch: pytest.MonkeyPatch, iterated: bool) -> None:
    between, within, vectors = known_problem(60)
    monkeypatch.setattr(discriminant, "_WHOLE", 10 if iterated else 100)
    found = leading_directions(between, within.copy(), 7)
    assert found.shape == (7, 60)
    signs = np.sign(np.einsum("df,df->d", found, vectors[:7]))
    np.testing.assert_allclose(found * signs[:, None], vectors[:7], atol=1e-5)
    np.testing.assert_allclose(found @ within @ found.T, np.eye(7), atol=1e-8)


def test_both_ways_to_the_leading_directions_agree_and_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    scatter = scatter_of(np.random.default_rng(3).normal(size=(2, 90, 50)).astype(np.float32))
    between, within = scatter.between(), scatter.within()
    add_ridge(within, 1.0)
    whole = leading_directions(between, within.copy(), 6)
    monkeypatch.setattr(discriminant, "_WHOLE", 10)
    iterated = leading_directions(between, within.copy(), 6)
    np.testing.assert_allclose(np.abs(iterated), np.abs(whole), atol=1e-4 * np.abs(whole).max())
    np.testing.assert_array_equal(leading_directions(between, within.copy(), 6), iterated)


def test_one_thread_solves_and_the_caller_keeps_his(monkeypatch: pytest.MonkeyPatch) -> None:
    def threads() -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    seen: list[set[int]] = []
    solve = scipy.linalg.eigh

    def noted(*given: Any, **options: Any) -> Any:
        seen.append(threads())
        return solve(*given, **options)

    monkeypatch.setattr(scipy.linalg, "eigh", noted)
    scatter = PlaceScatter(2, 6)
    scatter.add(np.random.default_rng(0).random((2, 40, 6), dtype=np.float32))
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        scatter.discriminant(2, 1.0)
        assert threads() == before
    assert seen == [{1}]
