"""What one drive knows: sums that add up over drives, and differences whose second moment is W."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from functools import reduce
from itertools import permutations

import numpy as np
import pytest

from everplace.adaptation.discriminant import PlaceScatter
from everplace.adaptation.drive_statistics import DriveStatistics, half_differences
from everplace.adaptation.moments import Moments


def of_a_drive(seed: int) -> DriveStatistics:
    rng = np.random.default_rng(seed)
    return DriveStatistics(*(Moments.of(rng.normal(size=(count, 4))) for count in (9, 5, 3 + seed)))


def flat(statistics: DriveStatistics) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    parts = (statistics.places, statistics.light, statistics.pairs)
    return np.concatenate([np.concatenate([[one.weight], one.total, one.products.ravel()]) for one in parts])


def test_the_order_of_drives_does_not_matter() -> None:
    drives = [of_a_drive(seed) for seed in range(3)]
    wanted = sum(flat(drive) for drive in drives)
    for order in permutations(drives):
        found = reduce(DriveStatistics.__add__, order, DriveStatistics.none(4))
        np.testing.assert_allclose(flat(found), wanted, atol=1e-12)


def of_blocks(places: np.ndarray[tuple[int, ...], np.dtype[np.float32]], weights: list[float]) -> DriveStatistics:
    """What a worker knows of the frames that it described: every other frame is seen in other light, too."""
    light = half_differences(places[::2], places[::2] * np.float32(0.7))
    return DriveStatistics(Moments.of(places, np.array(weights)), Moments.of(light), Moments.none(places.shape[1]))


def test_those_of_workers_merge_to_those_of_one_machine() -> None:
    rng = np.random.default_rng(5)
    places = rng.normal(size=(2400, 24)).astype(np.float32)
    weights = rng.uniform(0.1, 1, len(places))
    wanted = of_blocks(places, weights.tolist())
    spawning = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=spawning) as workers:
        blocks = [slice(start, start + 600) for start in range(0, len(places), 600)]
        parts = list(workers.map(of_blocks, [places[one] for one in blocks], [weights[one].tolist() for one in blocks]))
    for order in (parts, parts[::-1]):
        merged = reduce(DriveStatistics.__add__, order, DriveStatistics.none(24))
        np.testing.assert_allclose(flat(merged), flat(wanted), rtol=1e-12, atol=1e-10)


def test_each_sum_stays_its_own() -> None:
    both = of_a_drive(0) + of_a_drive(1)
    assert (both.places.weight, both.light.weight, both.pairs.weight) == (18, 10, 7)


def test_half_differences_have_the_covariance_within_places() -> None:
    rng = np.random.default_rng(0)
    within = np.diag([4.0, 1.0, 0.25])
    place = 10 * rng.normal(size=(200_000, 3))
    seen = [(place + rng.multivariate_normal(np.zeros(3), within, len(place))).astype(np.float32) for _ in range(2)]
    found = Moments.of(half_differences(*seen)).second_moment()
    np.testing.assert_allclose(found, within, atol=0.03)


def test_they_are_the_scatter_within_places_of_two_traverses() -> None:
    features = np.random.default_rng(1).normal(size=(2, 30, 6)).astype(np.float32)
    scatter = PlaceScatter(2, 6)
    scatter.add(features)
    found = Moments.of(half_differences(features[0], features[1])).second_moment()
    assert found == pytest.approx(scatter.within(), abs=1e-5)
