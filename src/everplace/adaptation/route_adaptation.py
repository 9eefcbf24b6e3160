"""From what drives know of a route to the projection of a descriptor that suits it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection, add_ridge, leading_directions
from everplace.adaptation.drive_statistics import DriveStatistics
from everplace.adaptation.moments import Moments
from everplace.adaptation.prior import Prior

__all__ = [
    "LIGHT_WEIGHT",
    "PRIOR_WEIGHT",
    "RIDGE",
    "adapted_projection",
    "fitting_prior_weight",
    "taught_projection",
    "within_places",
]

PRIOR_WEIGHT = 200.0
"""Pairs that the prior counts as, unless the route's own pairs tell that it does not fit."""
LIGHT_WEIGHT = 0.5
"""Pairs that other light counts as, for each place."""
RIDGE = 1.0
_RIDGE_PLACES = 200.0
"""Places at which the ridge is twice `RIDGE`: the fewer there are, the less their covariance is to be believed."""
_STRETCH = 24


def within_places(statistics: DriveStatistics, prior: Prior | None, prior_weight: float) -> NDArray[np.float64]:
    """W: how one place differs from itself, by pairs, other light and the prior, each by its weight.

    W = (m W0 + λ n L + Σ S) / (m + λ n + k) with k the weight of the pairs and S their sum, n the weight of the places,
    L the mean of other light, W0 the prior and m its weight. Differences of the conditions' means stay in.

    Returns:
        F×F.
    """
    places, light, pairs = statistics.places, statistics.light, statistics.pairs
    # Of many frames only some were seen in other light.
    light_weight = LIGHT_WEIGHT * places.weight if light.weight else 0.0
    total = pairs.products + light_weight * light.second_moment()
    weight = pairs.weight + light_weight
    if prior is not None and prior_weight:
        total = total + prior_weight * prior.within()
        weight += prior_weight
    return total / max(weight, np.finfo(np.float64).tiny)


def adapted_projection(
    statistics: DriveStatistics, dimensions: int, prior: Prior | None = None, prior_weight: float = PRIOR_WEIGHT
) -> Projection:
    """The projection that keeps what differs between the places of a route, and drops what differs at one place.

    Args:
        statistics: Of the map's drives added up; at least two places.
        dimensions: D; lowered to the number of places less one.
        prior: Scatter within places on other routes.
        prior_weight: Pairs that it counts as.

    Returns:
        At most D dimensions; over the frames of the map its output has mean 0 and variance 1 on average.
    """
    places = statistics.places
    dimensions = max(1, min(dimensions, round(places.weight) - 1, places.features))
    within = within_places(statistics, prior, prior_weight)
    add_ridge(within, RIDGE * (1 + _RIDGE_PLACES / places.weight))
    directions = leading_directions(places.covariance(), within, dimensions)
    return Projection.standardised(directions, places.mean, places.second_moment())


def taught_projection(
    statistics: DriveStatistics,
    changes: NDArray[np.float32],
    weights: NDArray[np.float64],
    dimensions: int,
    prior: Prior | None,
) -> tuple[Projection, float]:
    """The projection that a map and pairs of its places teach, with the prior weighed by how well it fits the pairs.

    Args:
        statistics: Of the map; its pairs are not read.
        changes: K×F of `half_differences`, in the order of travel; K may be 0.
        weights: (K,).
        dimensions: D; lowered to the number of places less one.
        prior: Scatter within places on other routes.

    Returns:
        The projection, and the pairs that the prior counted as; 0 without one.
    """
    prior_weight = 0.0 if prior is None else fitting_prior_weight(statistics, changes, weights, prior)
    taught = replace(statistics, pairs=Moments.of(changes, weights))
    return adapted_projection(taught, dimensions, prior, prior_weight), prior_weight


def fitting_prior_weight(
    statistics: DriveStatistics, differences: NDArray[np.float32], weights: NDArray[np.float64], prior: Prior
) -> float:
    """How many pairs a prior should count as, by the likelihood of pairs that were held out.

    The pairs are cut into stretches; every second one is held out in turn, and its differences are taken as normal
    with the covariance W of the others. Only the prior's own directions are looked at: elsewhere it says nothing.

    Args:
        statistics: Of the route; its pairs are not read.
        differences: K×F of `half_differences`, in the order of travel.
        weights: (K,).
        prior: The prior.

    Returns:
        `PRIOR_WEIGHT`, or less where it does not fit; all of it where there are too few pairs to tell.
    """
    stretch = np.arange(len(differences)) // _STRETCH
    if len(differences) < 2 * _STRETCH:
        return PRIOR_WEIGHT
    V = prior.directions.astype(np.float64)
    inside = differences @ V.T
    light = V @ statistics.light.second_moment() @ V.T
    known = np.diag(prior.variances.astype(np.float64)) + prior.rest * (V @ V.T)
    light_weight = LIGHT_WEIGHT * statistics.places.weight if statistics.light.weight else 0.0

    def log_likelihood(weight: float) -> float:
        total = 0.0
        for held in (stretch % 2 == 0, stretch % 2 == 1):
            rest = inside[~held] * np.sqrt(weights[~held])[:, None]
            W = rest.T @ rest + light_weight * light + weight * known
            W /= weights[~held].sum() + light_weight + weight
            add_ridge(W, 0.01)
            factor = scipy.linalg.cho_factor(W, lower=True)
            squares = np.einsum("kr,rk->k", inside[held], scipy.linalg.cho_solve(factor, inside[held].T))
            determinant = 2 * float(np.log(np.diag(factor[0])).sum())
            total -= 0.5 * float(weights[held] @ (squares + determinant))
        return total

    return max((PRIOR_WEIGHT * share for share in (1.0, 0.5, 0.25, 0.1, 0.0)), key=log_likelihood)
