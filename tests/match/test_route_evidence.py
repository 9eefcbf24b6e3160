"""The background of places and what is new in a frame: written out, on gaps, on stops, on places that attract."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.match.hidden_markov import MODELS, drive, evidence

from everplace.match.route_evidence import RouteEvidence
from everplace.match.route_filter import RouteFilter, filter_windows
from everplace.match.route_model import RouteModel, likelihood_ratios
from everplace.match.route_path import best_path, smooth_route


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 8), st.integers(1, 12), st.integers(0, 99), st.sampled_from(MODELS))
def test_it_is_what_is_written_out(frames: int, places: int, seed: int, model: RouteModel) -> None:
    S = np.random.default_rng(seed).normal(size=(frames, places)) ** 3
    ratios, news = RouteEvidence(places, model).weigh_all(S)
    expected = evidence(model, S)
    np.testing.assert_allclose(ratios, expected[0], rtol=1e-6)
    np.testing.assert_allclose(news, expected[1], rtol=1e-6, atol=1e-9)


def test_the_first_frame_stands_for_itself() -> None:
    S = drive([4], 20)
    ratios, new = RouteEvidence(20, RouteModel()).weigh(S[0])
    np.testing.assert_allclose(ratios, likelihood_ratios(S[0], RouteModel()))
    assert new == 1


def test_shift_and_scale_of_a_frame_do_not_matter() -> None:
    S = drive([*range(10)], 20)
    rng = np.random.default_rng(1)
    other = S * rng.uniform(0.1, 10, (10, 1)) + rng.normal(0, 100, (10, 1))
    for one, same in zip(
        RouteEvidence(20, RouteModel()).weigh_all(other), RouteEvidence(20, RouteModel()).weigh_all(S), strict=True
    ):
        np.testing.assert_allclose(one, same, rtol=1e-6)


def test_places_without_scores_do_not_disturb_the_others() -> None:
    S = drive([*range(8)], 15)
    S[4] = S[3]  # partly seen before
    gappy = np.insert(S, 6, np.nan, axis=1)
    ratios, news = RouteEvidence(16, RouteModel()).weigh_all(gappy)
    expected, same = RouteEvidence(15, RouteModel()).weigh_all(S)
    np.testing.assert_allclose(np.delete(ratios, 6, axis=1), expected)
    np.testing.assert_allclose(news, same, atol=1e-12)
    assert (ratios[:, 6] == 1).all()


@pytest.mark.parametrize("empty", [np.nan, 3.0])
def test_a_frame_that_says_nothing_is_no_background(empty: float) -> None:
    S = drive([*range(8)], 15)
    with_it, without = RouteEvidence(15, RouteModel()), RouteEvidence(15, RouteModel())
    for scores in S[:-1]:
        with_it.weigh(scores)
        without.weigh(scores)
    ratios, new = with_it.weigh(np.full(15, empty))
    assert (ratios == 1).all()
    assert new == 1
    np.testing.assert_array_equal(with_it.weigh(S[-1])[0], without.weigh(S[-1])[0])


def test_a_frame_seen_again_changes_nothing() -> None:
    S = drive([*range(10, 20)], 40)
    online = RouteFilter(40)
    for scores in S:
        online.update(scores)
    before = online.probabilities
    for _ in range(20):
        online.update(S[-1] * 2 + 1)
    np.testing.assert_allclose(online.probabilities, before, rtol=1e-9)


def test_a_robot_that_stands_does_not_talk_itself_into_a_place() -> None:
    # A chance agreement elsewhere in the frame of the stop, which only repetition could make a certainty.
    path = [*range(10, 20), *[20] * 30, *range(21, 25)]
    rng = np.random.default_rng(3)
    S = drive(path, 60)
    S[10, 50] = S[10, 20] + 1
    S[11:40] = S[10] + rng.normal(0, 0.05, (29, 60))
    followed = [RouteFilter(60), RouteFilter(60, RouteModel(repeat=1e-9))]
    places = np.array([[online.update(scores).place for online in followed] for scores in S])
    assert (np.abs(places[10:40, 0] - 20) <= 1).all()
    assert (np.abs(places[10:40, 1] - 20) > 1).any()
    assert (np.abs(best_path(S) - path) <= 1).mean() > 0.9
    smooth = np.array([answer.place for answer in smooth_route(S)])
    assert (np.abs(smooth - path) <= 1).mean() > 0.9


def test_what_is_new_goes_by_how_the_drive_usually_changes() -> None:
    rng = np.random.default_rng(4)
    common = rng.normal(size=50)
    news = {}
    for change in (1.0, 0.1):  # a drive of frames that are far apart, and one of frames that are nearly alike
        S = common + change * rng.normal(size=(60, 50))
        S[40:] = S[40] + change * 0.02 * rng.normal(size=(20, 50))
        news[change] = RouteEvidence(50, RouteModel()).weigh_all(S)[1]
    for values in news.values():
        assert values[20:41].mean() > 0.95
        assert values[41:].max() < 0.2


def test_a_place_that_attracts_every_frame_no_longer_does() -> None:
    path = [*range(10, 50)]
    S = drive(path, 60, separation=2.5)
    S[:, [3, 4, 5]] += 2.5
    attracted, freed = (
        (np.abs(filter_windows(S, 10, RouteModel(background=count)).argmax(axis=1)[10:] - path[10:]) <= 1).mean()
        for count in (1e9, 20.0)
    )
    assert freed > 0.95
    assert attracted < 0.8


def test_driving_to_and_fro_does_not_make_the_places_there_background() -> None:
    there = [*range(20, 30), *range(30, 20, -1)]
    path = there * 10
    found = filter_windows(drive(path, 60), 10).argmax(axis=1)
    assert (np.abs(found[100:] - path[100:]) <= 1).mean() > 0.9


def test_a_copy_goes_on_by_itself() -> None:
    S = drive([*range(12)], 30)
    first = RouteEvidence(30, RouteModel())
    first.weigh_all(S[:5])
    second = first.copy()
    second.weigh_all(-S)
    whole = RouteEvidence(30, RouteModel()).weigh_all(S)
    np.testing.assert_array_equal(first.weigh_all(S[5:])[0], whole[0][5:])
