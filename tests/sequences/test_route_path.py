"""Smoothing and the best path against the enumeration of all paths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.sequences.hidden_markov import MODELS, correlations_of_few_places, drive, every_path, worth
from tests.sequences.test_route_filter import DRIVES, PLACES

from everplace.sequences import route_path
from everplace.sequences.route_filter import RouteFilter
from everplace.sequences.route_model import RouteModel
from everplace.sequences.route_path import best_path, smooth_odds, smooth_route


@pytest.fixture(scope="module", autouse=True, params=[0, 64 << 20], ids=["segments", "in one"])
def _memory(request: pytest.FixtureRequest) -> Iterator[None]:
    """Short drives fit into memory whole; all must hold for long ones, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(route_path, "_MEMORY", request.param)
        yield


def test_segments_change_no_bit() -> None:
    S = np.random.default_rng(0).normal(size=(40, 30)).repeat(np.random.default_rng(1).integers(1, 4, 40), axis=0)
    whole, path = smooth_odds(S), best_path(S)
    for memory in (0, 8 * 4 * 30 * 9, 64 << 20):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(route_path, "_MEMORY", memory)
            np.testing.assert_array_equal(smooth_odds(S), whole)
            np.testing.assert_array_equal(best_path(S), path)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 99), st.sampled_from(MODELS))
def test_smoothing_sums_over_all_paths(frames: int, places: int, seed: int, model: RouteModel) -> None:
    S = np.random.default_rng(seed).normal(size=(frames, places))
    paths, p = every_path(model, S)
    p = p / p.sum()
    with correlations_of_few_places():
        answers = smooth_route(S, model, reach=0)
    for frame, answer in enumerate(answers):
        state = paths[:, frame]
        known = np.array([p[(state < 3 * places) & (state % places == place)].sum() for place in range(places)])
        assert answer.probability == pytest.approx(known[answer.place])
        assert worth(model, known)[answer.place] == pytest.approx(worth(model, known).max())
        assert answer.on_map == pytest.approx(p[state < 3 * places].sum())


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 99), st.sampled_from(MODELS))
def test_no_path_is_more_probable_than_the_best(frames: int, places: int, seed: int, model: RouteModel) -> None:
    S = np.random.default_rng(seed).normal(size=(frames, places))
    paths, p = every_path(model, S)
    with correlations_of_few_places():
        found = best_path(S, model)
    off = paths == 3 * places
    same = (np.where(off, -1, paths % places) == found).all(axis=1)  # gaits are not told
    assert p[same].max() == pytest.approx(p.max())


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_is_found_whole(name: str) -> None:
    path = DRIVES[name]
    S = drive(path, PLACES)
    smooth = np.array([answer.place for answer in smooth_route(S)])
    assert (np.abs(smooth - path) <= 1).mean() >= 0.9
    assert (np.abs(best_path(S) - path) <= 1).mean() >= 0.9


@settings(max_examples=5, deadline=None)
@given(st.lists(st.integers(1, 6), min_size=12, max_size=12), st.integers(0, 99))
def test_a_robot_that_stands_is_no_surer_of_its_place(stops: list[int], seed: int) -> None:
    S = drive([*range(10, 22)], PLACES, seed=seed, separation=9.0)
    scale, shift = np.random.default_rng(seed).uniform(0.5, 2, (2, sum(stops), 1))
    stopped = S.repeat(stops, axis=0) * scale + shift
    np.testing.assert_array_equal(best_path(stopped), best_path(S).repeat(stops))
    expected = [answer for answer, n in zip(smooth_route(S), stops, strict=True) for _ in range(n)]
    for answer, other in zip(smooth_route(stopped), expected, strict=True):
        assert astuple(answer) == pytest.approx(astuple(other), abs=0.01)


@pytest.mark.parametrize("frames", [5, 9, 40])
def test_a_blank_stretch_is_bridged(frames: int) -> None:
    path = np.arange(70)
    S = drive(path.tolist(), 80, separation=5.0)
    S[15 : 15 + frames] = np.eye(80)[3] * 12
    assert (np.abs(best_path(S) - path) <= 1).all()
    assert (np.abs(np.array([answer.place for answer in smooth_route(S)]) - path) <= 1).all()


def test_the_last_frame_has_no_future() -> None:
    S = drive([*range(10, 27)], PLACES)
    online = RouteFilter(PLACES)
    last = [online.update(scores) for scores in S][-1]
    smooth = smooth_route(S)[-1]
    assert smooth.place == last.place
    assert smooth.probability == pytest.approx(last.probability)
    assert smooth.on_map == pytest.approx(last.on_map)


def test_a_stretch_off_the_map_is_found() -> None:
    path = [*range(10, 25), *[-1] * 20, *range(30, 45)]
    S = drive(path, PLACES, separation=4.0)
    found = best_path(S)
    assert ((found == -1) == (np.array(path) == -1)).mean() > 0.9
    lost = np.array([answer.lost for answer in smooth_route(S)])
    assert (lost == (np.array(path) == -1)).mean() > 0.9


def test_frames_without_scores_are_bridged() -> None:
    path = [*range(10, 30)]
    S = drive(path, PLACES, separation=5.0)
    S[8:11] = np.nan
    assert (np.abs(best_path(S) - path) <= 1).all()
    assert all(abs(answer.place - place) <= 1 for answer, place in zip(smooth_route(S), path, strict=True))


def test_smoothed_odds_are_those_of_the_answers() -> None:
    rng = np.random.default_rng(5)
    S = rng.normal(size=(30, 25)) + 3 * (np.arange(30)[:, None] * 25 // 30 == np.arange(25))
    model = RouteModel()
    odds = smooth_odds(S, model)
    for row, found in zip(odds, smooth_route(S, model), strict=True):
        assert row.argmax() == found.place
    last = RouteFilter(25, model)
    for frame in S:
        last.update(frame)
    worth = model.worth(last.probabilities)
    np.testing.assert_allclose(odds[-1], np.log(worth / (1 - worth)), rtol=1e-3, atol=1e-3)
