"""What is new in a frame, against correlations computed one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.match.hidden_markov import news

from everplace.match.frame_change import UsualChange, change_between, frame_changes, new_in_frames
from everplace.match.route_model import RouteModel


def test_the_change_is_one_less_the_correlation() -> None:
    before, after = np.random.default_rng(0).random((2, 40))
    assert change_between(before, after) == pytest.approx(1 - np.corrcoef(before, after)[0, 1])
    assert change_between(before, 3 * before - 7) == pytest.approx(0, abs=1e-12)
    assert change_between(before, -before) == pytest.approx(2)


def test_only_places_with_both_scores_count() -> None:
    before, after = np.random.default_rng(1).random((2, 20))
    gappy, other = np.append(before, [np.nan, 0.5, np.inf]), np.append(after, [0.1, np.nan, 0.2])
    assert change_between(gappy, other) == pytest.approx(change_between(before, after))


@pytest.mark.parametrize("scores", [np.ones(40), np.full(40, np.nan), np.arange(9.0)])
def test_what_cannot_be_told_is_new(scores: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    assert np.isnan(change_between(scores, scores))
    assert new_in_frames(np.array([scores] * 3), 0.05).tolist() == [1.0, 1.0, 1.0]


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 12), st.integers(0, 99), st.sampled_from([0.05, 1.0, 3.0]))
def test_what_is_new_is_measured_by_the_usual_change(frames: int, seed: int, repeat: float) -> None:
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(frames, 30))
    for frame in range(1, frames):  # some frames are nearly the last one again
        S[frame] = S[frame - 1] + rng.choice([0.0, 0.01, 1.0]) * S[frame]
    np.testing.assert_allclose(new_in_frames(S, repeat), news(RouteModel(repeat=repeat), S), atol=1e-9)


def test_a_long_stop_does_not_become_the_usual() -> None:
    rng = np.random.default_rng(2)
    moving = rng.normal(size=(20, 100))
    noisy = moving[-1] + 0.01 * rng.normal(size=(2000, 100))
    assert new_in_frames(np.vstack([moving, noisy]), 0.05)[-1000:].max() < 0.05


def test_robots_do_not_disturb_each_other() -> None:
    changes = np.random.default_rng(3).uniform(0, 0.4, (6, 4))
    together = UsualChange.start(4)
    found = np.array([together.take(row.copy(), 0.3) for row in changes])
    for robot in range(4):
        alone = UsualChange.start(4)[robot : robot + 1]
        expected = [alone.take(row[robot : robot + 1], 0.3)[0] for row in changes]
        np.testing.assert_allclose(found[:, robot], expected)


def test_the_first_frame_has_no_change() -> None:
    S = np.random.default_rng(4).random((3, 12))
    changes = frame_changes(S)
    assert np.isnan(changes[0])
    assert changes[1:] == pytest.approx([change_between(S[0], S[1]), change_between(S[1], S[2])])
