"""Sure pairs: found along a drive however it was driven, and none in a drive of elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import DescriptorsError
from everplace.mapping.self_teaching import SurePairs, _in_runs, _over_visits, sure_pairs

D = 40


def views(count: int, seed: int) -> NDArray[np.float32]:
    """Places of a way: neighbours have a cosine of one half."""
    steps = np.random.default_rng(seed).normal(size=(count + 1, D))
    return np.asarray(steps[1:] + steps[:-1], np.float32)


def seen(places: NDArray[np.float32], seed: int, noise: float = 1.0, shift: float = 3.0) -> Descriptors:
    """The same views on another drive, all of them changed in one way, and each in its own."""
    values = places + noise * np.random.default_rng(seed).normal(size=places.shape) + shift
    return Descriptors(values.astype(np.float32), tuple(map(str, range(len(values)))), "m")


def right(pairs: SurePairs, true: NDArray[np.int64]) -> float:
    return float((np.abs(true[pairs.frames] - pairs.places) <= 1).mean())


MAP = views(150, 0)
AHEAD = np.arange(150)


@pytest.mark.parametrize(
    "driven",
    [
        AHEAD,
        AHEAD[::-1],
        np.r_[0:60, 110:30:-1, 30:80],
        AHEAD[::2],
        np.repeat(AHEAD, 2),
        np.r_[0:50, [50] * 60, 51:150],
        AHEAD[40:100],
    ],
    ids=["as the map", "backwards", "with turns", "twice as fast", "half as fast", "with a stop", "a part"],
)
def test_a_drive_along_the_map_is_matched(driven: NDArray[np.int64]) -> None:
    pairs = sure_pairs(seen(MAP, 1), seen(MAP[driven], 2))
    assert pairs.of == len(driven)
    assert pairs.share == len(pairs.frames) / len(driven) > 0.6
    assert right(pairs, driven) > 0.97
    assert (np.diff(pairs.frames) > 0).all()
    assert (pairs.log_odds > 2).all()


def test_what_was_found_for_frames_that_are_not_sure_is_told_too() -> None:
    driven = np.r_[0:60, 90:150]
    pairs = sure_pairs(seen(MAP, 1), seen(np.concatenate([MAP[:60], views(30, 7), MAP[90:]]), 2))
    assert pairs.matches is not None
    assert len(pairs.matches.places) == len(pairs.matches.log_odds) == 150
    np.testing.assert_array_equal(pairs.matches.places[pairs.frames], pairs.places)
    np.testing.assert_array_equal(pairs.matches.log_odds[pairs.frames], pairs.log_odds)
    assert len(np.intersect1d(pairs.frames, driven)) > 0.6 * len(driven)
    assert np.median(pairs.matches.log_odds[60:90]) < 2 < np.median(pairs.matches.log_odds[driven])


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_of_elsewhere_has_no_pair(seed: int) -> None:
    pairs = sure_pairs(seen(MAP, 1), seen(views(200, 100 + seed), 2))
    assert (len(pairs.frames), len(pairs.places), len(pairs.log_odds), pairs.share) == (0, 0, 0, 0.0)


@pytest.mark.parametrize(
    "mapped",
    [np.r_[0:150, 0:40], np.r_[0:150, 0:150], np.r_[0:150, 149:-1:-1], np.r_[0:150, 20:60, 20:60]],
    ids=["loop", "two rounds", "there and back", "three visits"],
)
def test_a_map_that_saw_places_several_times_is_matched(mapped: NDArray[np.int64]) -> None:
    pairs = sure_pairs(seen(MAP[mapped], 1, noise=0.5), seen(MAP, 2))
    shown = mapped[pairs.places]
    assert (np.abs(shown - pairs.frames) <= 1).mean() > 0.97
    assert pairs.share > 0.6


def odds_of(*frames: dict[int, float]) -> NDArray[np.float32]:
    """Log-odds of probabilities by place, of a map of 40."""
    p = np.full((len(frames), 40), 0.001)
    for row, frame in zip(p, frames, strict=True):
        row[list(frame)] = list(frame.values())
    return np.asarray(np.log(p / (1 - p)), np.float32)


def test_what_speaks_for_one_visit_speaks_for_the_place() -> None:
    views = np.eye(40, dtype=np.float32)
    views[30:33] = views[10:13]
    frames = ({10: 0.5, 30: 0.4}, {11: 0.3, 31: 0.6}, {12: 0.5, 32: 0.4999}, {20: 0.7, 30: 0.2})
    places, odds = _over_visits(odds_of(*frames), views)
    assert places.tolist() == [10, 11, 12, 20], "it goes on where it began"
    np.testing.assert_allclose(1 / (1 + np.exp(-odds)), [0.9, 0.9, 0.9999, 0.7], atol=1e-4)


def test_frames_beside_each_other_are_one_visit() -> None:
    views = np.eye(40, dtype=np.float32)
    views[12] = views[14] = views[10]
    places, odds = _over_visits(odds_of({10: 0.5, 12: 0.45, 14: 0.4}), views)
    assert places.tolist() == [10]
    np.testing.assert_allclose(odds, 0, atol=1e-5)


def test_a_detour_is_left_out() -> None:
    driven = np.concatenate([MAP[:60], views(40, 9), MAP[60:]])
    true = np.r_[0:60, [-10] * 40, 60:150]
    pairs = sure_pairs(seen(MAP, 1), seen(driven, 2))
    assert right(pairs, true) > 0.95
    assert pairs.share > 0.5


@pytest.mark.parametrize("frames", [1, 2, 9])
def test_too_few_frames_are_never_sure(frames: int) -> None:
    assert len(sure_pairs(seen(MAP, 1, 0.1), seen(MAP[:frames], 2, 0.1)).frames) == 0


def test_a_drive_that_stands_is_no_run() -> None:
    assert len(sure_pairs(seen(MAP, 1), seen(views(1, 50).repeat(80, axis=0), 2, 0.05)).frames) == 0


def test_descriptors_of_two_methods_are_refused() -> None:
    other = seen(MAP, 2)
    with pytest.raises(DescriptorsError):
        sure_pairs(seen(MAP, 1), Descriptors(other.values, other.names, "n"))


def by_loops(sure: list[bool], places: list[int]) -> list[bool]:
    kept = [False] * len(sure)
    start = 0
    for index in range(1, len(sure) + 1):
        goes_on = index < len(sure) and sure[index] and sure[index - 1] and abs(places[index] - places[index - 1]) <= 3
        if not goes_on:
            if sure[start] and index - start >= 10:
                kept[start:index] = [True] * (index - start)
            start = index
    return kept


@given(
    st.lists(st.tuples(st.sampled_from([True] * 9 + [False]), st.sampled_from([0, 1, 1, 1, 2, 3, -1, 40])), min_size=1)
)
@settings(max_examples=150, deadline=None)
def test_runs_are_those_of_their_definition(steps: list[tuple[bool, int]]) -> None:
    sure, places = [one[0] for one in steps], np.cumsum([one[1] for one in steps])
    assert _in_runs(np.array(sure), places).tolist() == by_loops(sure, places.tolist())
