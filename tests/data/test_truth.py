from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.data.natural_order import natural_key, natural_sorted
from everplace.data.traverse import Traverse
from everplace.data.truth import truth_by_pose, truth_by_position
from everplace.errors import ConfigError, RouteError


def drive(stems: list[str], positions: list[tuple[float, float]] | None = None) -> Traverse:
    poses = None if positions is None else np.array([(x, y, 0.0) for x, y in positions]).reshape(-1, 3)
    return Traverse("t", "c", Path("/r/t"), tuple(stems), (".png",) * len(stems), poses)


stem_lists = st.lists(st.integers(0, 30), unique=True, max_size=10).map(
    lambda numbers: natural_sorted(["anchor", *map(str, numbers)])
)


def test_tolerance_counts_places_not_digits() -> None:
    query, database = drive(["10", "20", "50"]), drive(["10", "20", "50"])
    assert truth_by_position(query, database, 1).tolist() == [
        [True, True, False],
        [True, True, True],
        [False, True, True],
    ]


@pytest.mark.parametrize("tolerance", [3, 2**63 - 1, 10**20])
def test_a_tolerance_beyond_the_route_makes_all_places_the_same(tolerance: int) -> None:
    assert truth_by_position(drive(["1", "3"]), drive(["2", "3", "4"]), tolerance).all()


def test_places_that_only_one_side_has_are_counted() -> None:
    assert truth_by_position(drive(["1", "3"]), drive(["1", "2", "3"]), 1).tolist() == [
        [True, True, False],
        [False, True, True],
    ]


def test_frames_in_any_order() -> None:
    shuffled = drive(["1", "2", "3", "4"]).take([2, 0, 3, 1])
    truth = truth_by_position(shuffled, drive(["1", "2", "3", "4"]), 0)
    assert np.argmax(truth, axis=1).tolist() == [2, 0, 3, 1]
    np.testing.assert_array_equal(truth_by_position(drive(["1", "2", "3", "4"]), shuffled, 0), truth.T)


@given(stem_lists, stem_lists, st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_truth_against_its_definition(query: list[str], database: list[str], tolerance: int) -> None:
    truth = truth_by_position(drive(query), drive(database), tolerance)

    places = sorted(set(query) | set(database), key=natural_key)
    expected = [[abs(places.index(a) - places.index(b)) <= tolerance for b in database] for a in query]
    np.testing.assert_array_equal(truth, np.array(expected))
    np.testing.assert_array_equal(truth_by_position(drive(database), drive(query), tolerance), truth.T)
    assert (truth <= truth_by_position(drive(query), drive(database), tolerance + 1)).all()
    same = np.array([[a == b for b in database] for a in query])
    np.testing.assert_array_equal(truth_by_position(drive(query), drive(database), 0), same)


def test_no_shared_stem_and_negative_tolerance() -> None:
    with pytest.raises(RouteError, match="share no stem"):
        truth_by_position(drive(["1"]), drive(["2"]), 1)
    with pytest.raises(ConfigError, match="tolerance -1 is negative"):
        truth_by_position(drive(["1"]), drive(["1"]), -1)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 80.0))
@settings(max_examples=30, deadline=None)
def test_truth_by_pose_against_brute_force(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    here, there = rng.uniform(-50, 50, (7, 2)), rng.uniform(-50, 50, (11, 2))
    query = drive([str(i) for i in range(7)], [(float(x), float(y)) for x, y in here])
    database = drive([str(i) for i in range(11)], [(float(x), float(y)) for x, y in there])

    truth = truth_by_pose(query, database, radius)

    expected = np.hypot(*(here[:, None] - there[None]).transpose(2, 0, 1)) <= radius
    np.testing.assert_array_equal(truth, expected)
    np.testing.assert_array_equal(truth_by_pose(database, query, radius), truth.T)


def test_the_radius_is_included() -> None:
    query, database = drive(["1"], [(0.0, 0.0)]), drive(["1", "2"], [(3.0, 4.0), (3.0, 4.001)])
    assert truth_by_pose(query, database, 5.0).tolist() == [[True, False]]


@pytest.mark.parametrize("radius", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_radius(radius: float) -> None:
    with pytest.raises(ConfigError, match="radius"):
        truth_by_pose(drive(["1"], [(0, 0)]), drive(["1"], [(0, 0)]), radius)


def test_missing_poses_name_the_remedy() -> None:
    with pytest.raises(RouteError, match=r"'t' has no poses; put a poses\.csv"):
        truth_by_pose(drive(["1"], [(0, 0)]), drive(["1"]), 5.0)
