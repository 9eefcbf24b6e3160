"""From sums to a projection: against the formulas written out, and what a prior is trusted with."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.adaptation.drive_statistics import DriveStatistics
from everplace.adaptation.moments import Moments
from everplace.adaptation.prior import Prior
from everplace.adaptation.route_adaptation import (
    PRIOR_WEIGHT,
    adapted_projection,
    fitting_prior_weight,
    taught_projection,
    within_places,
)

F = 10


def drawn(seed: int, count: int, deviations: NDArray[np.float64]) -> NDArray[np.float32]:
    return (np.random.default_rng(seed).normal(size=(count, F)) * deviations).astype(np.float32)


PLACES = drawn(0, 300, np.linspace(3, 1, F)) + np.float32(4)
LIGHT = drawn(1, 50, np.linspace(0.2, 1, F))
PAIRS = drawn(2, 80, np.linspace(1, 0.3, F))


def route(places: bool = True, light: bool = True, pairs: bool = True) -> DriveStatistics:
    parts = ((places, PLACES), (light, LIGHT), (pairs, PAIRS))
    return DriveStatistics(*(Moments.of(x) if known else Moments.none(F) for known, x in parts))


def prior_of(within: NDArray[np.float64]) -> Prior:
    return Prior.of(within, "hog16", {})


def outer(x: NDArray[np.float32]) -> NDArray[np.float64]:
    found: NDArray[np.float64] = x.T.astype(float) @ x
    return found


def test_within_places_is_the_weighted_mean_of_what_is_known() -> None:
    prior = prior_of(np.diag(np.linspace(2, 1, F)))
    light = outer(LIGHT) / 50
    wanted = (60 * prior.within() + 0.5 * 300 * light + outer(PAIRS)) / (60 + 0.5 * 300 + 80)
    np.testing.assert_allclose(within_places(route(), prior, 60), wanted, rtol=1e-9)
    np.testing.assert_allclose(
        within_places(route(), None, 60), (150 * light + outer(PAIRS)) / 230, rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(within_places(route(light=False), None, 0), outer(PAIRS) / 80, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(within_places(route(light=False, pairs=False), prior, 200), prior.within())
    assert (within_places(route(light=False, pairs=False), None, 0) == 0).all()


def test_a_change_of_everything_stays_within_places() -> None:
    shifted = DriveStatistics(Moments.of(PLACES), Moments.none(F), Moments.of(np.ones((5, F))))
    np.testing.assert_allclose(within_places(shifted, None, 0), np.ones((F, F)))


def by_hand(dimensions: int) -> NDArray[np.float64]:
    """Directions of B v = λ (W + ridge) v by an eigenproblem that is not symmetric, each of length 1."""
    between = np.cov(PLACES.T.astype(float), ddof=0)
    within = (0.5 * 300 * outer(LIGHT) / 50 + outer(PAIRS)) / (150 + 80)
    within += (1 + 200 / 300) * np.trace(within) / F * np.eye(F)
    values, vectors = np.linalg.eig(np.linalg.solve(within, between))
    order = np.argsort(values.real)[::-1][:dimensions]
    found: NDArray[np.float64] = vectors.real[:, order].T
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return found


def test_the_projection_is_the_discriminant_written_out() -> None:
    weight = adapted_projection(route(), 4).weight
    unit = weight / np.linalg.norm(weight, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((unit * by_hand(4)).sum(axis=1)), 1, atol=1e-9)


def test_the_map_comes_out_centred_and_of_variance_one() -> None:
    projection = adapted_projection(route(), 6)
    z = PLACES @ projection.weight.T + projection.bias
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=1e-5)
    assert z.var(axis=0).mean() == pytest.approx(1)


def test_drives_add_up_in_any_order() -> None:
    none = Moments.none(F)
    first = DriveStatistics(Moments.of(PLACES), Moments.of(LIGHT), none)
    parts = [first, *(DriveStatistics(none, none, Moments.of(rows)) for rows in np.split(PAIRS, [13, 50]))]
    wanted = adapted_projection(route(), 5).weight
    for order in ((0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 1, 0)):
        total = DriveStatistics.none(F)
        for index in order:
            total += parts[index]
        found = adapted_projection(total, 5).weight
        np.testing.assert_allclose(np.abs(found), np.abs(wanted), atol=1e-8)


@pytest.mark.parametrize(("places", "asked", "given"), [(300, 4, 4), (300, 50, F), (7, 50, 6), (2, 50, 1)])
def test_dimensions_end_with_the_places_less_one_and_the_numbers(places: int, asked: int, given: int) -> None:
    statistics = DriveStatistics(Moments.of(PLACES[:places]), Moments.of(LIGHT), Moments.none(F))
    assert len(adapted_projection(statistics, asked).bias) == given


@pytest.mark.parametrize("copies", [3, 7, 49])
def test_places_of_many_frames_are_counted_as_places(copies: int) -> None:
    weights = np.full(7 * copies, 1 / copies)
    places = Moments.of(np.repeat(PLACES[:7], copies, axis=0), weights)
    found = adapted_projection(DriveStatistics(places, Moments.of(LIGHT), Moments.none(F)), 50)
    assert len(found.bias) == 6


def test_a_prior_steers_where_nothing_else_is_known() -> None:
    noisy = np.ones(F)
    noisy[:3] = 100.0
    places = DriveStatistics(Moments.of(drawn(3, 400, np.ones(F))), Moments.none(F), Moments.none(F))
    weight = adapted_projection(places, 5, prior_of(np.diag(noisy))).weight
    unit = weight / np.linalg.norm(weight, axis=1, keepdims=True)
    assert np.square(unit[:, :3]).sum(axis=1).max() < 0.05


def weight_of(prior: NDArray[np.float64], pairs: NDArray[np.float32]) -> float:
    statistics = DriveStatistics(Moments.of(PLACES), Moments.none(F), Moments.of(pairs))
    return fitting_prior_weight(statistics, pairs, np.ones(len(pairs)), prior_of(prior))


def test_a_prior_that_fits_is_believed_and_one_that_does_not_is_not() -> None:
    deviations = np.linspace(2, 0.2, F)
    pairs = drawn(4, 120, deviations)
    assert weight_of(np.diag(np.square(deviations)), pairs) == PRIOR_WEIGHT
    assert weight_of(np.diag(np.square(deviations[::-1])), pairs) == 0
    assert weight_of(100 * np.diag(np.square(deviations)), pairs) < PRIOR_WEIGHT / 2


def test_of_few_pairs_a_prior_is_believed() -> None:
    deviations = np.linspace(2, 0.2, F)
    assert weight_of(np.diag(np.square(deviations[::-1])), drawn(4, 47, deviations)) == PRIOR_WEIGHT


def test_what_the_pairs_of_a_map_teach_is_what_they_teach_as_part_of_the_statistics() -> None:
    weights = np.ones(len(PAIRS))
    taught, prior_weight = taught_projection(route(pairs=False), PAIRS, weights, 4, None)
    assert prior_weight == 0
    np.testing.assert_array_equal(taught.weight, adapted_projection(route(), 4).weight)
    assert not np.allclose(taught.weight, adapted_projection(route(pairs=False), 4).weight)
    prior = prior_of(np.diag(np.linspace(2, 1, F)))
    with_prior, prior_weight = taught_projection(route(pairs=False), PAIRS, weights, 4, prior)
    assert prior_weight == fitting_prior_weight(route(pairs=False), PAIRS, weights, prior) > 0
    np.testing.assert_array_equal(with_prior.weight, adapted_projection(route(), 4, prior, prior_weight).weight)
