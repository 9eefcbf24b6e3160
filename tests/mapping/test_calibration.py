from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import CheckpointError, DescriptorsError
from everplace.mapping.calibration import (
    ON_MAP,
    PROVISIONAL,
    Calibration,
    _KnownQueries,
    best_place,
    fit_calibration,
    hidden,
    likelihood_ratios_of,
    place_posterior,
)
from everplace.mapping.reliability import expected_calibration_error
from everplace.mapping.standard_scores import score_moments
from everplace.sequences.route_filter import Belief
from everplace.sequences.route_model import RouteModel


class World:
    """A route of P places of length-1 descriptors, of which neighbours are alike, and noisy frames of it."""

    def __init__(self, places: int, seed: int, dimensions: int = 96) -> None:
        self._rng = np.random.default_rng(seed)
        drawn = self._rng.standard_normal((places + 2, dimensions)).astype(np.float32)
        self.database = _unit(drawn[1:-1] + 0.4 * (drawn[:-2] + drawn[2:]))

    def frames(self, true: NDArray[np.int64], noise: float = 0.15) -> NDArray[np.float32]:
        spread = noise * self._rng.uniform(0.3, 1.7, (len(true), 1)).astype(np.float32)  # some are harder than others
        dimensions = self.database.shape[1]
        return _unit(
            self.database[true] + spread * self._rng.standard_normal((len(true), dimensions)).astype(np.float32)
        )

    def scores(self, true: NDArray[np.int64]) -> NDArray[np.float32]:
        return self.frames(true) @ self.database.T


@pytest.fixture(scope="module")
def fitted() -> Calibration:
    true = np.arange(1000)
    return fit_calibration(World(1000, 0).scores(true), true, 1)


def test_a_fit_is_calibrated_on_its_held_out_frames(fitted: Calibration) -> None:
    assert not fitted.provisional
    assert fitted.queries == 1000
    assert fitted.expected_error is not None
    assert fitted.expected_error_interval is not None
    assert fitted.expected_error < 0.04
    assert fitted.expected_error_interval[0] <= fitted.expected_error_interval[1] < 0.08
    assert fitted.brier is not None
    assert fitted.brier < 0.15


@pytest.mark.parametrize(
    "places", [200, 1000, pytest.param(10_000, marks=pytest.mark.slow), pytest.param(100_000, marks=pytest.mark.slow)]
)
def test_a_calibration_holds_on_maps_of_other_sizes(fitted: Calibration, places: int) -> None:
    # Fitted on 1,000 places; the map is another one.
    frames = 600 if places <= 10_000 else 300
    world, true = World(places, 1), np.linspace(0, places - 1, frames).astype(np.int64)
    said, right, off = _answers(world.scores(true), true, fitted)
    # It may doubt a little too much, never be too sure.
    assert -0.02 < right[:, 0].mean() - said[:, 0].mean() < 0.07
    weights = np.broadcast_to(np.array([ON_MAP, 1 - ON_MAP]), said.shape)
    assert expected_calibration_error(said, right, weights) < 0.08
    assert expected_calibration_error(off, np.broadcast_to([False, True], off.shape), weights) < 0.05


def test_a_calibration_that_is_wrong_is_seen_to_be(fitted: Calibration) -> None:
    world, true = World(1000, 1), np.arange(1000)
    said, right, _ = _answers(world.scores(true), true, replace(fitted, slope=2.5 * fitted.slope))
    assert expected_calibration_error(said, right) > 0.12


def test_probabilities_sum_to_one_whatever_the_scale_of_the_scores(fitted: Calibration) -> None:
    S = World(300, 2).scores(np.arange(0, 300, 7))
    probabilities, off = place_posterior(S, fitted)
    assert np.allclose(probabilities.sum(axis=1) + off, 1)
    for other in (3 * S + 5, S.astype(np.float64) * 1e-3, S.reshape(1, *S.shape)):
        again, off_again = place_posterior(other, fitted)
        assert np.allclose(again.reshape(S.shape), probabilities, atol=1e-4)
        assert np.allclose(off_again.ravel(), off, atol=1e-4)
    one, off_one = place_posterior(S[3], fitted)
    assert one.shape == (300,)
    assert off_one.shape == ()
    assert np.array_equal(one, probabilities[3])


def test_places_without_a_score_do_not_exist(fitted: Calibration) -> None:
    S = World(300, 3).scores(np.array([20, 40, 290]))
    wide = np.full((3, 500), np.nan)
    wide[:, 100:400] = S
    probabilities, off = place_posterior(wide, fitted)
    known, known_off = place_posterior(S, fitted)
    assert np.allclose(probabilities[:, 100:400], known)
    assert np.allclose(off, known_off)
    assert not probabilities[:, :100].any()


@pytest.mark.parametrize("score", [0.0, 0.7, -1e6])
def test_a_frame_whose_scores_are_equal_says_nothing(score: float) -> None:
    probabilities, off = place_posterior(np.full(50, score), PROVISIONAL)
    assert np.allclose(probabilities, ON_MAP / 50)
    assert np.isclose(off, 1 - ON_MAP)
    assert np.array_equal(likelihood_ratios_of(np.full(50, score), PROVISIONAL), np.ones(50))


def test_a_frame_without_scores_is_off_the_map() -> None:
    probabilities, off = place_posterior(np.full((2, 9), np.nan), PROVISIONAL)
    assert not probabilities.any()
    assert off.tolist() == [1, 1]
    assert np.array_equal(likelihood_ratios_of(np.full((2, 9), np.nan), PROVISIONAL), np.ones((2, 9)))


def test_scores_of_any_size_overflow_nothing() -> None:
    S = np.zeros((1, 100_000))
    S[0, 7] = 1e6
    probabilities, off = place_posterior(S, replace(PROVISIONAL, slope=20.0))
    assert probabilities[0, 7] == pytest.approx(1)
    assert off[0] == pytest.approx(0)


def test_the_best_of_a_search_are_read_like_all(fitted: Calibration) -> None:
    world = World(5000, 4)
    frames = world.frames(np.arange(0, 5000, 100))
    S = frames @ world.database.T
    database = world.database.astype(np.float64)
    whole = score_moments(frames, database.mean(axis=0), np.cov(database.T, bias=True), len(database))
    assert np.allclose(whole.mean, S.mean(axis=1), atol=1e-5)
    assert np.allclose(whole.deviation, S.std(axis=1), atol=1e-5)
    best = np.where(np.sort(S, axis=1)[:, -100:-99] <= S, S, np.nan)  # what an approximate search finds
    all_places, off = place_posterior(S, fitted)
    found, off_found = place_posterior(best, fitted, whole)
    assert np.abs(found - all_places).max() < 0.02
    assert np.abs(off_found - off).max() < 0.02


def test_ratios_are_the_odds_of_the_posterior(fitted: Calibration) -> None:
    S = World(200, 5).scores(np.arange(0, 200, 9))
    probabilities, off = place_posterior(S, fitted)
    ratios = likelihood_ratios_of(S, replace(fitted, temper=1.0))
    assert np.allclose(ratios * ON_MAP / 200 * (off / (1 - ON_MAP))[:, None], probabilities)
    assert np.allclose(likelihood_ratios_of(S, replace(fitted, temper=0.5)), np.sqrt(ratios))


def test_the_odds_beforehand_are_those_of_the_filter() -> None:
    model = RouteModel()
    assert model.start == pytest.approx(ON_MAP)
    S = World(200, 6).scores(np.array([77]))
    belief = Belief.start(model, 1, 200)
    belief.see(likelihood_ratios_of(S, replace(PROVISIONAL, temper=1.0)))
    probabilities, off = place_posterior(S, PROVISIONAL)
    assert np.allclose(belief.places, probabilities)
    assert np.allclose(belief.off, off)


def test_the_best_place_is_given_with_its_neighbours() -> None:
    probabilities = np.array([[0.5, 0.2, 0.1, 0.0], [0.0, 0.1, 0.2, 0.6]])
    place, probability = best_place(probabilities, 1)
    assert place.tolist() == [0, 3]
    assert probability.tolist() == pytest.approx([0.7, 0.8])
    assert best_place(probabilities, 0)[1].tolist() == pytest.approx([0.5, 0.6])
    place, probability = best_place(probabilities[0], 3)
    assert int(place) == 0
    assert float(probability) == pytest.approx(0.8)


def test_hidden_places_are_three_reaches_wide() -> None:
    S = hidden(np.zeros((2, 12)), np.array([0, 6]), 1)
    assert [np.flatnonzero(np.isnan(row)).tolist() for row in S] == [[0, 1, 2, 3], [3, 4, 5, 6, 7, 8, 9]]


def test_maps_of_different_sizes_are_fitted_together() -> None:
    small, large = World(150, 7), World(400, 8)
    S = np.full((550, 400), np.nan)
    S[:150, :150], S[150:] = small.scores(np.arange(150)), large.scores(np.arange(400))
    both = fit_calibration(S, np.concatenate([np.arange(150), np.arange(400)]), 1)
    alone = fit_calibration(S[150:], np.arange(400), 1)
    assert both.slope == pytest.approx(alone.slope, rel=0.2)
    assert both.expected_error is not None
    assert both.expected_error < 0.06


def test_few_frames_stay_near_the_provisional_calibration(fitted: Calibration) -> None:
    S = World(1000, 0).scores(np.arange(1000))
    few = fit_calibration(S[:10], np.arange(10), 1)
    assert few.expected_error is few.brier is None
    assert abs(np.log(few.slope / PROVISIONAL.slope)) < abs(np.log(fitted.slope / PROVISIONAL.slope)) + 0.2
    assert few.queries == 10


def test_the_gradient_of_the_fit_is_that_of_its_loss() -> None:
    true = np.arange(0, 120, 3)
    queries = _KnownQueries(World(120, 9).scores(true).astype(np.float64), true, 1)
    for point in (np.array([-2.0, 1.0, -0.5]), np.array([0.0, 0.3, 0.1])):
        _, gradient = queries.loss(point)
        steps = 1e-5 * np.eye(3)
        slopes = [(queries.loss(point + step)[0] - queries.loss(point - step)[0]) / 2e-5 for step in steps]
        assert gradient == pytest.approx(slopes, rel=1e-5)


@pytest.mark.parametrize(
    ("shape", "places"), [((0, 5), []), ((2, 5), [1]), ((2, 5), [1, 5]), ((2, 5), [-1, 2]), ((5,), [1])]
)
def test_frames_that_cannot_be_fitted_to_are_refused(shape: tuple[int, ...], places: list[int]) -> None:
    with pytest.raises(DescriptorsError, match="its place on the map"):
        fit_calibration(np.zeros(shape), np.array(places, np.int64), 1)


def test_a_calibration_goes_through_json(fitted: Calibration) -> None:
    for calibration in (fitted, PROVISIONAL):
        assert Calibration.from_dict(json.loads(json.dumps(calibration.to_dict()))) == calibration


@pytest.mark.parametrize(
    "change",
    [
        {"slope": None},
        {"slope": -1.0},
        {"offset": "x"},
        {"trust": float("nan")},
        {"temper": 0},
        {"brier_interval": [1]},
    ],
)
def test_a_damaged_calibration_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(CheckpointError, match="damaged"):
        Calibration.from_dict({**PROVISIONAL.to_dict(), **change})
    with pytest.raises(CheckpointError, match="damaged"):
        Calibration.from_dict({})


def _answers(
    S: NDArray[np.float32], true: NDArray[np.int64], calibration: Calibration
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """M×2, on the map and off it: what is said, whether it is right, and the probability of being off."""
    said, right, off = np.empty((len(S), 2)), np.zeros((len(S), 2), bool), np.empty((len(S), 2))
    for start in range(0, len(S), 50):
        rows = slice(start, start + 50)
        for column, shown in enumerate((S[rows], hidden(S[rows], true[rows], 1))):
            probabilities, off[rows, column] = place_posterior(shown, calibration)
            place, said[rows, column] = best_place(probabilities, 1)
            right[rows, column] = (np.abs(place - true[rows]) <= 1) & (column == 0)
    return said, right, off


def _unit(values: NDArray[np.float32]) -> NDArray[np.float32]:
    unit: NDArray[np.float32] = values / np.linalg.norm(values, axis=1, keepdims=True)
    return unit
