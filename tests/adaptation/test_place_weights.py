"""How much a frame counts: a place once, however often and long it was seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.adaptation import place_weights as module
from everplace.adaptation.place_weights import pair_weights, place_weights


def walk(places: int, seed: int = 0, features: int = 200) -> NDArray[np.float32]:
    """Views of a walk about a common mean: neighbours have a cosine of one half."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(places + 1, features))
    return np.asarray(5 + steps[1:] + steps[:-1], np.float32)


def alike(view: NDArray[np.float32], count: int, seed: int = 1) -> NDArray[np.float32]:
    """Frames of one view, whose noise has a fiftieth of the variance of places."""
    noise = np.random.default_rng(seed).normal(size=(count, len(view)))
    return np.asarray(view + 0.2 * noise, np.float32)


def test_different_views_count_once_each() -> None:
    assert (place_weights(walk(80)) == 1).all()


def test_a_place_that_is_seen_twice_counts_half_each_time() -> None:
    there = walk(60)
    back = np.concatenate([there, there[::-1]])
    np.testing.assert_array_equal(place_weights(back), np.full(120, 0.5))


@pytest.mark.parametrize(("places", "standing"), [(300, 20), (100, 100), (60, 500), (20, 1000)])
def test_a_stop_counts_once(places: int, standing: int) -> None:
    views, here = walk(places), places // 3
    features = np.concatenate([views[:here], alike(views[here], standing), views[here + 1 :]])
    weights = place_weights(features)
    assert weights[here : here + standing].sum() == pytest.approx(1.0, rel=0.05)
    assert (np.delete(weights, slice(here, here + standing)) == 1).mean() > 0.95


def test_two_stops_are_two_places() -> None:
    views = walk(30)
    features = np.concatenate([alike(views[0], 40), views[1:29], alike(views[29], 80)])
    assert place_weights(features).sum() == pytest.approx(30, rel=0.02)


@given(seed=st.integers(0, 2**31), gain=st.floats(0.1, 10), offset=st.floats(-10, 10))
@settings(max_examples=15, deadline=None)
def test_scale_and_origin_of_the_numbers_do_not_matter(seed: int, gain: float, offset: float) -> None:
    views = walk(12, seed)
    features = np.concatenate([views, alike(views[5], 6)])
    np.testing.assert_allclose(place_weights(np.float32(gain) * features + np.float32(offset)), place_weights(features))


def test_blocks_do_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    features = np.concatenate([walk(30), alike(walk(30)[3], 25)])
    whole = place_weights(features)
    monkeypatch.setattr(module, "_BLOCK", 7 * len(features))
    np.testing.assert_array_equal(place_weights(features), whole)


@pytest.mark.parametrize("count", [1, 2, 40])
def test_a_drive_that_sees_nothing_gives_numbers(count: int) -> None:
    weights = place_weights(np.full((count, 9), 0.3, np.float32))
    assert ((weights > 0) & (weights <= 1)).all()


def by_loops(
    places: NDArray[np.int64], map_weights: NDArray[np.float64], own: NDArray[np.float64]
) -> NDArray[np.float64]:
    found = own.copy()
    for place in set(places.tolist()):
        here = places == place
        if own[here].sum() > map_weights[place]:
            found[here] *= map_weights[place] / own[here].sum()
    return found


@given(seed=st.integers(0, 2**31), pairs=st.integers(1, 30))
@settings(max_examples=40, deadline=None)
def test_pairs_weigh_no_more_than_their_place(seed: int, pairs: int) -> None:
    rng = np.random.default_rng(seed)
    places, map_weights, own = rng.integers(0, 6, pairs), rng.uniform(0.1, 1, 6), rng.uniform(0.1, 1, pairs)
    found = pair_weights(places, map_weights, own)
    np.testing.assert_allclose(found, by_loops(places, map_weights, own))
    assert (np.bincount(places, found, 6) <= map_weights + 1e-12).all()
    assert (found <= own + 1e-12).all()
