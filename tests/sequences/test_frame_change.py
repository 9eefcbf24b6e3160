"""What is new in a frame, against correlations of NumPy's and on drives that change quickly and slowly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from tests.sequences.hidden_markov import shown

from everplace.sequences.evidence import likelihood_ratios, standardised
from everplace.sequences.frame_change import View, change_in_steps, new_frames
from everplace.sequences.route_filter import filter_windows
from everplace.sequences.route_model import RouteModel


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(11, 40), st.integers(0, 99), st.sampled_from([0.05, 1.0, 3.0]))
def test_the_change_is_measured_by_that_of_a_step(frames: int, places: int, seed: int, repeat: float) -> None:
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(frames, places))
    for frame in range(1, frames):  # some frames are nearly the last one again
        S[frame] = S[frame - 1] + rng.choice([0.0, 0.1, 1.0]) * S[frame]
    model = RouteModel(repeat=repeat)
    assert new_frames(S, model).tolist() == np.unique(shown(model, S)).tolist()


def test_a_step_along_the_map_is_one_step() -> None:
    S, _ = along(4, noise=0.0)
    views = [View.of(ratios) for ratios in likelihood_ratios(standardised(S), RouteModel())]
    steps = [change_in_steps(views[frame], views[frame + 1]) for frame in range(50, 150)]
    assert np.median(steps) == pytest.approx(1, rel=0.1)


def test_shift_and_scale_of_the_scores_do_not_matter() -> None:
    S = np.random.default_rng(0).normal(size=(12, 40)).repeat([1, 3] * 6, axis=0)
    scale, shift = np.random.default_rng(1).uniform(0.5, 2, (2, len(S), 1))
    assert new_frames(S * scale + shift, RouteModel()).tolist() == [0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21]


def test_places_without_scores_say_nothing() -> None:
    S = np.random.default_rng(2).normal(size=(3, 30)).repeat(2, axis=0)
    S[:, [3, 20]] = np.nan
    S[::2, 7], S[::2, 8] = np.inf, -np.inf
    assert new_frames(S, RouteModel()).tolist() == [0, 1, 2, 3, 4, 5]
    assert new_frames(np.delete(S, [7, 8], axis=1), RouteModel()).tolist() == [0, 2, 4]


@pytest.mark.parametrize(
    "scores",
    [
        np.full(40, 0.1),
        np.full(40, 0.3),
        np.where(np.arange(40) % 2, 0.3, np.nextafter(0.3, 1)),  # equal but for rounding
        np.full(40, np.nan),
        np.arange(9.0) ** 2,
    ],
)
def test_what_cannot_be_told_is_new(scores: NDArray[np.float64]) -> None:
    assert new_frames(np.array([scores] * 3), RouteModel()).tolist() == [0, 1, 2]


def along(
    smoothness: float, frames_a_place: int = 1, *, noise: float = 1.5, places: int = 200
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Scores of a drive along places whose looks change smoothly, and the place of each frame."""
    rng = np.random.default_rng(2)
    frames = places * frames_a_place

    def looks() -> NDArray[np.float64]:
        values: NDArray[np.float64] = gaussian_filter1d(rng.normal(size=(frames, 64)), smoothness, axis=0, mode="wrap")
        values /= values.std()
        return values

    seen, place = looks(), np.arange(frames) // frames_a_place
    query, database = seen + noise * looks(), seen[frames_a_place // 2 :: frames_a_place]
    query /= np.linalg.norm(query, axis=1, keepdims=True)
    return query @ (database / np.linalg.norm(database, axis=1, keepdims=True)).T, place


def found(S: NDArray[np.float64], place: NDArray[np.int64], length: int, repeat: float) -> float:
    windows = filter_windows(S, length, RouteModel(repeat=repeat)).argmax(axis=1)
    return float((np.abs(windows - place) <= 1).mean())


@pytest.mark.parametrize("smoothness", [1, 6, 25])
def test_a_road_that_changes_slowly_is_no_stop(smoothness: float) -> None:
    S, place = along(smoothness)
    repeat = RouteModel().repeat
    assert len(new_frames(S, RouteModel())) > 0.97 * len(S)
    assert found(S, place, 10, repeat) == pytest.approx(found(S, place, 10, 1e-9), abs=0.005)


def test_many_frames_of_each_place_do_not_freeze_the_filter() -> None:
    S, place = along(60, 10)
    assert found(S, place, 100, RouteModel().repeat) >= found(S, place, 100, 1e-9)


def test_a_camera_that_stands_is_seen_in_spite_of_its_noise() -> None:
    S, _ = along(3)
    noise = np.random.default_rng(3).normal(size=(200, S.shape[1]))
    stop = S[100] + 0.01 * S[100].std() * noise
    new = new_frames(np.vstack([S[:101], stop, S[101:]]), RouteModel())
    assert not ((new > 100) & (new <= 300)).any()
    assert new[-1] == 299 + len(S) - 100


def test_a_motion_too_slow_to_see_from_frame_to_frame_adds_up() -> None:
    S, _ = along(3)
    share = np.linspace(0, 1, 400)[:, None]
    slow = (1 - share) * S[100] + share * S[101]
    new = new_frames(slow, RouteModel())
    assert 3 < len(new) < 40
    assert np.diff(new).max() < 100
