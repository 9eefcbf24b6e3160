"""The filter against the forward recursion written out, and on drives with stops, turns, jumps and gaps."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.sequences.hidden_markov import MODELS, correlations_of_few_places, drive, forward, shown, worth

from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences import route_filter
from everplace.sequences.route_filter import RouteFilter, filter_windows
from everplace.sequences.route_model import RouteModel
from everplace.sequences.sequence_search import search_sequences

PLACES = 60
DRIVES = {
    "from the start": [*range(25)],
    "from the middle": [*range(33, 58)],
    "with stops": [*range(20, 30), *[30] * 8, *range(31, 38)],
    "backwards": [*range(50, 25, -1)],
    "turning round": [*range(20, 35), *range(33, 18, -1)],
    "skipping": [*range(10, 50, 2)],
    "slowly": [place // 2 for place in range(40, 80)],
    "kidnapped": [*range(5, 20), *range(40, 55)],
}


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 6), st.integers(1, 5), st.integers(0, 99), st.sampled_from(MODELS))
def test_it_is_the_forward_recursion(frames: int, places: int, seed: int, model: RouteModel) -> None:
    S = np.random.default_rng(seed).normal(size=(frames, places))
    online = RouteFilter(places, model, reach=0)
    for scores, expected in zip(S, forward(model, S), strict=True):
        with correlations_of_few_places():
            answer = online.update(scores)
        known = expected[:-1].reshape(3, places).sum(axis=0)
        np.testing.assert_allclose(online.probabilities, known)
        assert answer.probability == pytest.approx(known[answer.place])
        assert answer.on_map == pytest.approx(1 - expected[-1])
        assert worth(model, known)[answer.place] == pytest.approx(worth(model, known).max())


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 7), st.integers(2, 5), st.integers(1, 9), st.integers(0, 99), st.sampled_from(MODELS))
def test_a_window_is_a_filter_that_starts_with_it(
    frames: int, places: int, length: int, seed: int, model: RouteModel
) -> None:
    S = np.random.default_rng(seed).normal(size=(frames, places))
    with correlations_of_few_places():
        odds = filter_windows(S, length, model)
        shows = shown(model, S)
    for row in range(frames):
        begin = np.unique(shows[: row + 1])[-length:][0]
        with correlations_of_few_places():
            states = forward(model, S[: row + 1], begin)[-1]
        p = worth(model, states[:-1].reshape(3, places).sum(axis=0))
        np.testing.assert_allclose(odds[row], np.log(p / (1 - p)), rtol=1e-4, atol=1e-5)


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    S = np.random.default_rng(3).normal(size=(23, 8))
    whole = filter_windows(S, 6)
    for size in (1, 8, 8 * 4, 8 * 7):
        monkeypatch.setattr(route_filter, "_BLOCK", size)
        np.testing.assert_array_equal(filter_windows(S, 6), whole)


def test_windows_are_causal_and_forget() -> None:
    S = np.random.default_rng(4).normal(size=(12, 9))
    changed = S.copy()
    changed[[3, 10]] += np.arange(9)
    equal = (filter_windows(S, 4) == filter_windows(changed, 4)).all(axis=1)
    assert equal.tolist() == [True] * 3 + [False] * 4 + [True] * 3 + [False] * 2


def test_a_window_longer_than_the_traverse_is_all_of_it() -> None:
    S = np.random.default_rng(5).normal(size=(5, 9))
    np.testing.assert_array_equal(filter_windows(S, 500), filter_windows(S, 5))
    online = RouteFilter(9)
    for scores in S:
        online.update(scores)
    p = worth(RouteModel(), online.probabilities)
    np.testing.assert_allclose(filter_windows(S, 500)[-1], np.log(p / (1 - p)), rtol=1e-4)


@pytest.mark.parametrize("name", DRIVES)
def test_a_drive_is_followed(name: str) -> None:
    path = DRIVES[name]
    S = drive(path, PLACES, separation=2.5)
    online = RouteFilter(PLACES)
    answers = [online.update(scores) for scores in S]
    windows = filter_windows(S, 10).argmax(axis=1)
    followed = [abs(answer.place - place) <= 1 for answer, place in zip(answers, path, strict=True)]
    in_windows = np.abs(windows - path) <= 1
    alone = np.abs(S.argmax(axis=1) - path) <= 1
    # Three frames to find the place, or to believe a turn or a jump.
    assert sum(followed) >= len(path) - 3 > alone.sum()
    assert in_windows.sum() >= len(path) - 3
    assert answers[-1].probability > 0.6
    assert not answers[-1].lost


@settings(max_examples=10, deadline=None)
@given(st.lists(st.integers(1, 12), min_size=8, max_size=8), st.integers(1, 9), st.integers(0, 99))
def test_a_robot_that_stands_is_no_surer_of_its_place(stops: list[int], length: int, seed: int) -> None:
    S = drive([*range(10, 18)], PLACES, seed=seed, separation=9.0)
    scale, shift = np.random.default_rng(seed).uniform(0.5, 2, (2, sum(stops), 1))
    stopped = S.repeat(stops, axis=0) * scale + shift
    windows, moved = filter_windows(stopped, length), filter_windows(S, length).repeat(stops, axis=0)
    np.testing.assert_array_equal(windows.argmax(axis=1), moved.argmax(axis=1))
    assert (windows.max(axis=1) < moved.max(axis=1) + 0.05).all()
    moving, standing = RouteFilter(PLACES), RouteFilter(PLACES)
    expected = [answer for scores, n in zip(S, stops, strict=True) for answer in [moving.update(scores)] * n]
    for scores, answer in zip(stopped, expected, strict=True):
        assert astuple(standing.update(scores)) == pytest.approx(astuple(answer), abs=0.1)


BLANKS = {
    "another place": np.eye(PLACES)[50] * 12,
    "grey": np.zeros(PLACES),
    "every second place, not this one": np.arange(1, PLACES + 1) % 2 * 1.0,
}


@pytest.mark.parametrize("name", BLANKS)
@pytest.mark.parametrize("frames", [5, 9, 40])
def test_a_robot_drives_on_through_one_and_the_same_image(name: str, frames: int) -> None:
    path = np.arange(70) if frames == 40 else np.arange(40)
    S = drive(path.tolist(), 80 if frames == 40 else PLACES, separation=5.0)
    blank = np.append(BLANKS[name], np.zeros(S.shape[1] - PLACES))
    S[15 : 15 + frames] = blank
    online = RouteFilter(S.shape[1])
    followed = np.array([online.update(scores).place for scores in S])
    assert (np.abs(followed - path)[3:18] <= 1).all()
    assert (np.abs(followed - path)[17 + frames :] <= 1).all()
    assert (np.abs(filter_windows(S, 10).argmax(axis=1) - path)[3:18] <= 1).all()


@pytest.mark.parametrize("alike", [5, 9, 15])
def test_a_robot_drives_on_where_the_map_looks_alike_too(alike: int) -> None:
    path = np.arange(40)
    S = drive(path.tolist(), PLACES, separation=5.0)
    S[15 : 15 + alike] = S[15]
    S[:, 15 : 15 + alike] = S[:, [15]]
    assert (np.abs(filter_windows(S, 10).argmax(axis=1) - path)[3:] <= 1).all()


def test_a_veil_over_all_frames_is_not_a_place() -> None:
    rng = np.random.default_rng(4)
    path = np.arange(5, 55)
    S = drive(path.tolist(), PLACES, separation=3.0) + 4 * rng.normal(size=PLACES)
    assert (np.abs(S.argmax(axis=1) - path) <= 1).mean() < 0.3
    found = np.abs(filter_windows(S, 10).argmax(axis=1) - path) <= 1
    assert found[9:].mean() > 0.9


@pytest.mark.parametrize(("separation", "length"), [(2.0, 10), (2.0, 20), (4.0, 5), (4.0, 10)])
def test_at_the_speed_of_the_map_it_finds_what_the_mean_finds(separation: float, length: int) -> None:
    path = [*range(500)]
    S = drive(path, 500, separation=separation, seed=3)
    found = [
        (np.abs(search_sequences(S, length, method).argmax(axis=1) - path) <= 1).mean() for method in ("filter", "mean")
    ]
    assert found[0] >= found[1] - 0.01


def test_frames_that_are_nowhere_are_off_the_map() -> None:
    path = [*range(10, 25), *[-1] * 20, *range(30, 45)]
    online = RouteFilter(PLACES)
    answers = [online.update(scores) for scores in drive(path, PLACES, separation=4.0)]
    lost = np.array([answer.lost for answer in answers])
    assert not lost[5:15].any()
    assert lost[25:35].all()
    assert not lost[40:].any()
    assert max(answer.probability for answer in answers[25:35]) < 0.5


def test_a_frame_without_scores_moves_on() -> None:
    S = drive([*range(10, 30)], PLACES, separation=5.0)
    S[12] = np.nan
    online = RouteFilter(PLACES)
    answers = [online.update(scores) for scores in S]
    assert answers[12].place == 22
    assert answers[12].probability < answers[11].probability
    assert np.isfinite(filter_windows(S, 5)).all()


def test_scores_may_be_shifted_and_scaled_frame_by_frame() -> None:
    S = drive([*range(10, 30)], PLACES)
    rng = np.random.default_rng(6)
    other = S * rng.uniform(0.1, 10, (20, 1)) + rng.normal(0, 100, (20, 1))
    np.testing.assert_allclose(filter_windows(other, 10), filter_windows(S, 10), atol=1e-4)


def test_of_places_that_look_alike_the_middle_is_the_answer() -> None:
    S = np.zeros((1, 30))
    S[0, 10:15] = [1.0, 1.0, 1.0, 1.0, 1.01]
    assert filter_windows(S, 1, RouteModel(beside=0.0)).argmax() == 14
    assert filter_windows(S, 1).argmax() == RouteFilter(30).update(S[0]).place == 13
    S[0, 10:15] = [0.0, 0.0, 2.0, 0.0, 1.0]
    assert filter_windows(S, 1).argmax() == RouteFilter(30).update(S[0]).place == 12


def test_certainty_grows_with_the_frames_that_agree() -> None:
    frames = np.arange(12)
    S = np.random.default_rng(7).random((12, 30)) * 1e-3
    S[frames, 7 + frames] = 50.0 + frames
    odds = filter_windows(S, 12)
    assert (odds.argmax(axis=1) == 7 + frames).all()
    assert np.isfinite(odds).all()
    # One frame, however sure of the place, leaves the chance to be off the map as it was, but for the doubt.
    model = RouteModel()
    on_map = RouteFilter(30).update(S[0]).on_map
    says = np.log((30 - 29 * model.outlier) ** 2 / 30 + 29 * model.outlier**2 / 30)
    expected = np.log(model.start / (1 - model.start)) - model.doubt * says
    assert np.log(on_map / (1 - on_map)) == pytest.approx(expected, abs=0.05)
    certainty = odds[frames, 7 + frames]
    assert (np.diff(certainty[:5]) > 0.1).all()
    assert certainty[-1] > 6


def test_certainty_keeps_its_digits() -> None:
    frames = np.arange(20)
    S = np.random.default_rng(7).random((20, 30)) * 1e-3
    S[frames, 7 + frames] = 1.0
    never = 1e-60
    surely = RouteModel(
        leave=never, jump=never, turn=never, outlier=never, doubt=0.0, even=(0.0, 1.0), steps=(0.0, 1.0)
    )
    odds = filter_windows(S, 20, surely)
    assert np.isfinite(odds).all()
    certainty = odds[frames, 7 + frames]
    assert (np.diff(certainty) > 0.1).all()
    assert certainty[-1] > 40  # 1 - w is then less than a double can tell from 0 beside 1


def test_the_filter_keeps_no_frames() -> None:
    online = RouteFilter(4)
    for scores in np.random.default_rng(8).normal(size=(300, 4)):
        online.update(scores)
    sizes = {name: np.asarray(value).size for name, value in vars(online).items() if isinstance(value, np.ndarray)}
    assert sizes == {}
    assert online._last is not None
    assert online._last.view.evidence.size == 4
    assert online.probabilities.shape == (4,)
    assert 0 < online.probabilities.sum() < 1


def test_wrong_use_is_refused() -> None:
    with pytest.raises(ConfigError, match="0 places"):
        RouteFilter(0)
    with pytest.raises(ConfigError, match="reach"):
        RouteFilter(3, reach=-1)
    with pytest.raises(DescriptorsError, match="map of 3 places"):
        RouteFilter(3).update(np.ones(4))
    with pytest.raises(ConfigError, match="a sequence of 0 frames"):
        filter_windows(np.ones((2, 2)), 0)
