from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.errors import ConfigError
from everplace.importing.positions import shared_places as alignment
from everplace.importing.positions.shared_places import (
    align_all_by_pairs,
    align_all_by_position,
    align_by_pairs,
    align_by_position,
    best_chain,
    sparsest,
)

WEIGHTS = arrays(np.int64, st.tuples(st.integers(1, 7), st.integers(1, 7)), elements=st.integers(0, 4))
METRES = st.floats(-50, 50, allow_nan=False)


def positions(frames: int) -> st.SearchStrategy[NDArray[np.float64]]:
    return arrays(np.float64, (frames, 2), elements=METRES)


TRACK = st.integers(1, 8).flatmap(positions)


def largest_sum(weights: NDArray[np.int64]) -> int:
    """The textbook table, every cell visited."""
    M, N = weights.shape
    table = np.zeros((M + 1, N + 1), np.int64)
    for i in range(M):
        for j in range(N):
            table[i + 1, j + 1] = max(table[i, j + 1], table[i + 1, j], table[i, j] + weights[i, j])
    return int(table[-1, -1])


def chain_of(weights: NDArray[np.int64]) -> alignment.Assignment:
    rows = ((np.flatnonzero(row), row[row > 0].astype(np.float64)) for row in weights)
    return best_chain(weights.shape[1], rows)


@pytest.mark.parametrize("kept", [2, 1 << 20])
@given(WEIGHTS)
@settings(max_examples=100, deadline=None)
def test_the_chain_is_the_best_there_is(kept: int, weights: NDArray[np.int64]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(alignment, "_COMPACT_ABOVE", kept)
        i, j = chain_of(weights)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    assert (weights[i, j] > 0).all()
    assert weights[i, j].sum() == largest_sum(weights)


@given(TRACK, TRACK, st.floats(0.5, 200))
@settings(max_examples=60, deadline=None)
def test_positions_are_assigned_one_to_one_in_order_and_within_the_radius(
    a: NDArray[np.float64], b: NDArray[np.float64], radius: float
) -> None:
    i, j = align_by_position(a, b, radius)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    distances = np.linalg.norm(a[i] - b[j], axis=1)
    assert (distances < radius).all()
    scores = np.maximum(1 - np.linalg.norm(a[:, None] - b, axis=2) / radius, 0) ** 2
    best = max(
        (float(scores[list(rows), list(columns)].sum()) for rows, columns in all_assignments(*scores.shape)),
        default=0.0,
    ) if max(scores.shape) <= 4 else 0.0  # fmt: skip
    assert scores[i, j].sum() >= best - 1e-9


def all_assignments(M: int, N: int) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    from itertools import combinations

    return [
        (rows, columns)
        for size in range(1, min(M, N) + 1)
        for rows in combinations(range(M), size)
        for columns in combinations(range(N), size)
    ]


@given(TRACK, st.floats(0.5, 200))
@settings(max_examples=40, deadline=None)
def test_equal_drives_are_assigned_frame_by_frame(track: NDArray[np.float64], radius: float) -> None:
    i, j = align_by_position(track, track, radius)
    np.testing.assert_array_equal(i, np.arange(len(track)))
    np.testing.assert_allclose(track[i], track[j])


@given(TRACK, TRACK)
@settings(max_examples=40, deadline=None)
def test_driving_both_ways_backwards_assigns_as_much(a: NDArray[np.float64], b: NDArray[np.float64]) -> None:
    def total(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
        i, j = align_by_position(first, second, 30.0)
        return float(((1 - np.linalg.norm(first[i] - second[j], axis=1) / 30.0) ** 2).sum())

    assert total(a, b) == pytest.approx(total(a[::-1], b[::-1]))
    assert total(a, b) == pytest.approx(total(b, a))


def test_two_passes_through_one_street_are_told_apart_by_the_order() -> None:
    there = np.column_stack([np.arange(0.0, 50.0), np.zeros(50)])
    drive = np.concatenate([there, there[::-1]])
    slower = np.repeat(drive, 2, axis=0)
    i, j = align_by_position(drive, slower, 5.0)
    assert len(i) == 100
    np.testing.assert_array_equal(slower[j], drive[i])
    assert (np.abs(j // 2 - i) <= 1).all()  # at the turn two frames show the same place


def test_frames_of_a_stop_and_of_other_places_have_no_partner() -> None:
    moving = np.column_stack([np.arange(0.0, 40.0, 2.0), np.zeros(20)])
    stopping = np.concatenate([moving[:10], np.repeat(moving[9:10], 30, axis=0), moving[10:], [[500.0, 0.0]]])
    i, j = align_by_position(moving, stopping, 1.5)
    np.testing.assert_array_equal(i, np.arange(20))
    np.testing.assert_array_equal(stopping[j], moving)


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_a_radius_that_is_none(radius: float) -> None:
    with pytest.raises(ConfigError, match="is not a positive number of metres"):
        align_by_position(np.zeros((1, 2)), np.zeros((1, 2)), radius)


def test_drives_sparser_than_the_reference_do_not_miss_each_other() -> None:
    reference = np.column_stack([np.arange(100.0), np.zeros(100)])
    places = align_all_by_position({"even": reference[::2], "all": reference, "odd": reference[1::2]}, "all", 2.0)
    assert list(places) == ["even", "all", "odd"]
    np.testing.assert_array_equal(places["all"], np.arange(0, 100, 2))
    np.testing.assert_array_equal(places["even"], np.arange(50))
    np.testing.assert_array_equal(places["odd"], np.arange(50))


def test_the_sparsest_drive_is_the_first_of_those_with_the_fewest_frames() -> None:
    assert sparsest({"a": 3, "b": 2, "c": 2}) == "b"


ANCHORS = st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=1, max_size=5).map(
    lambda steps: np.cumsum(np.array([(0, 0), *steps]), axis=0)
)


@given(ANCHORS)
@settings(max_examples=60, deadline=None)
def test_pairs_are_met_and_between_them_frames_go_in_proportion(pairs: NDArray[np.int64]) -> None:
    frames = np.arange(pairs[-1, 0] + 5)
    i, j = align_by_pairs(pairs, frames)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    assert set(map(tuple, pairs.tolist())) <= set(zip(i.tolist(), j.tolist(), strict=True))
    np.testing.assert_array_less(np.abs(np.interp(i, pairs[:, 0], pairs[:, 1]) - j), 0.5 + 1e-9)


@given(st.integers(2, 30))
@settings(max_examples=10, deadline=None)
def test_pairs_of_equal_drives_give_the_identity(frames: int) -> None:
    last = frames - 1
    places = align_all_by_pairs({"a": frames, "b": frames}, "a", {"b": np.array([(0, 0), (last, last)])})
    np.testing.assert_array_equal(places["a"], np.arange(frames))
    np.testing.assert_array_equal(places["b"], np.arange(frames))


def test_nothing_is_assigned_outside_the_pairs() -> None:
    i, j = align_by_pairs(np.array([(3, 10), (5, 14)]), np.arange(9))
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == [(3, 10), (4, 12), (5, 14)]
