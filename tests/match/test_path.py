from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.describe.descriptors import Descriptors
from everplace.match import path as path_module
from everplace.match.path import contrast, crooked, find_path, judge_path, local_path, rivals, thin, thinning

STEP_COST = 0.5
SCORES = arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.floats(-4, 4, allow_nan=False))


def described(values: NDArray[np.floating]) -> Descriptors:
    return Descriptors(values.astype(np.float32), tuple(map(str, range(len(values)))), "test")


def drives(places: NDArray[np.int64], noise: float, seed: int = 0, total: int = 120) -> tuple[Descriptors, Descriptors]:
    """A drive past all places, and one that sees the given places, with noise on every frame."""
    rng = np.random.default_rng(seed)
    world = rng.normal(size=(total, 64))
    first = world + noise * rng.normal(size=world.shape)
    second = world[places] + noise * rng.normal(size=(len(places), 64))
    return described(first), described(second)


def best_by_table(scores: NDArray[np.float64]) -> float:
    """The recursion of the docstring, cell by cell."""
    M, N = scores.shape
    table = np.full((M + 1, N + 1), -np.inf)
    best = 0.0
    for i in range(M):
        for j in range(N):
            gain = scores[i, j]
            table[i + 1, j + 1] = max(
                max(table[i, j], 0.0) + 2 * gain,
                table[i, j + 1] + gain - STEP_COST,
                table[i + 1, j] + gain - STEP_COST,
            )
            best = max(best, table[i + 1, j + 1])
    return best


def worth(scores: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> float:
    """What a path is worth, step by step."""
    total = 0.0
    for k, (i, j) in enumerate(zip(rows, columns, strict=True)):
        straight = k > 0 and (i == rows[k - 1] or j == columns[k - 1])
        total += scores[i, j] - STEP_COST if straight else 2 * scores[i, j]
    return total


@given(SCORES)
@settings(max_examples=100, deadline=None)
def test_the_path_is_the_best_local_alignment(scores: NDArray[np.float64]) -> None:
    rows, columns = local_path((0, row) for row in scores)
    steps = np.column_stack([np.diff(rows), np.diff(columns)]).tolist()
    assert all(step in ([1, 1], [1, 0], [0, 1]) for step in steps)
    assert worth(scores, rows, columns) == pytest.approx(best_by_table(scores))


@given(SCORES, st.integers(0, 3))
@settings(max_examples=60, deadline=None)
def test_along_a_band_only_its_cells_count(scores: NDArray[np.float64], width: int) -> None:
    M, N = scores.shape
    lows = [max(0, min(i, N) - width) for i in range(M)]
    highs = [min(N, i + width + 1) for i in range(M)]
    banded = np.full_like(scores, -1e9)
    for i, (low, high) in enumerate(zip(lows, highs, strict=True)):
        banded[i, low:high] = scores[i, low:high]
    rows, columns = local_path((low, row[low:high]) for low, high, row in zip(lows, highs, scores, strict=True))
    assert worth(scores, rows, columns) == pytest.approx(best_by_table(banded))
    assert all(lows[i] <= j < highs[i] for i, j in zip(rows.tolist(), columns.tolist(), strict=True))


@given(arrays(np.float32, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.floats(-1, 1, width=32)))
@settings(max_examples=40, deadline=None)
def test_contrast_takes_what_rows_and_columns_share(S: NDArray[np.float32]) -> None:
    base = contrast(S).scores + 1
    shifted = contrast(S + np.arange(S.shape[0], dtype=np.float32)[:, None]).scores + 1
    if (S - S.mean(axis=1, keepdims=True) - S.mean(axis=0) + S.mean()).std() > 1e-3:
        np.testing.assert_allclose(base.mean(axis=0), 0, atol=1e-3)
        np.testing.assert_allclose(base.mean(axis=1), 0, atol=1e-3)
        np.testing.assert_allclose(shifted, base, atol=2e-2)


@pytest.mark.parametrize(
    "places",
    [
        np.arange(120),
        np.arange(30, 90),
        np.arange(0, 120, 2),
        np.repeat(np.arange(20, 80), 2),
        np.concatenate([np.arange(60), np.full(25, 60), np.arange(61, 120)]),
    ],
    ids=["equal", "part", "twice as fast", "half as fast", "with a stop"],
)
def test_a_drive_is_found_in_another_whatever_its_speed(places: NDArray[np.int64]) -> None:
    first, second = drives(places, noise=0.7)
    i, j = find_path(first, second)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    assert len(i) >= 0.97 * len(np.unique(places))
    assert (places[j] == i).mean() >= 0.97


@pytest.mark.parametrize("most", [16, 30])
def test_long_drives_are_searched_coarsely_and_then_in_a_band(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    # Neighbouring frames must look alike for every so many-th frame to show the way.
    rng = np.random.default_rng(3)
    world = np.cumsum(rng.normal(size=(240, 64)), axis=0)
    places = np.sort(rng.choice(240, 200, replace=False))
    first, second = described(world), described(world[places] + 0.3 * rng.normal(size=(200, 64)))
    monkeypatch.setattr(path_module, "_MOST_FRAMES", most)
    monkeypatch.setattr(path_module, "_ROWS", 7)
    assert thinning(240) > 1
    assert len(thin(first).descriptors) <= most
    i, j = find_path(first, second)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    assert len(i) > 180
    assert (np.abs(places[j] - i) <= 1).mean() > 0.97
    judged = judge_path(thin(first), thin(second), (i, j))
    assert judged.strides == (thinning(240), thinning(200))
    assert len(judged.unsure) == len(i)


def test_a_path_without_rivals_is_sure() -> None:
    first, second = drives(np.arange(120), noise=0.5)
    judged = judge_path(thin(first), thin(second), find_path(first, second))
    assert not judged.unsure.any()


def test_a_stretch_that_comes_twice_and_one_that_looks_like_nothing_are_unsure() -> None:
    rng = np.random.default_rng(1)
    world = rng.normal(size=(120, 64))
    world[60:80] = world[20:40]
    second = world + 0.3 * rng.normal(size=world.shape)
    second[95:110] = rng.normal(size=(15, 64))
    everywhere = np.arange(120)
    judged = judge_path(thin(described(world)), thin(described(second)), (everywhere, everywhere))
    assert judged.unsure[100:105].all()
    assert judged.unsure[25:35].any() or judged.unsure[65:75].any()
    assert not judged.unsure[np.r_[0:15, 45:55]].any()


@pytest.mark.parametrize("seed", range(3))
def test_a_path_through_a_drive_along_another_road_is_no_better_than_chance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Neighbouring frames look alike, as they do on every road; that alone makes short paths.
    roads = np.cumsum(rng.normal(size=(2, 150, 64)), axis=1)
    first, second = (described(np.asarray(road - road.mean(axis=0))) for road in roads)
    judged = judge_path(thin(first), thin(second), find_path(first, second))
    assert judged.by_chance
    assert judged.unsure.all()
    own = judge_path(thin(first), thin(first), find_path(first, first))
    assert not own.by_chance


def test_a_path_is_crooked_where_one_drive_stands() -> None:
    rows = np.arange(60)
    columns = np.where(rows < 30, 2 * rows, 2 * rows + 80)
    bent = crooked((rows, columns))
    assert bent[28:32].all()
    assert not bent[np.r_[0:24, 36:60]].any()
    assert not crooked((rows, 5 * rows)).any()
    assert crooked((np.array([4]), np.array([9]))).tolist() == [False]


def test_rivals_of_a_single_pair() -> None:
    scores = np.full((1, 40), -1, np.float32)
    scores[0, 3] = 2
    pair = (np.array([0]), np.array([3]))
    assert not rivals(scores, pair)[0]
    scores[0, 30] = 3
    assert rivals(scores, pair)[0]


def test_nothing_alike_gives_no_pairs_or_few() -> None:
    flat = described(np.ones((5, 3)))
    i, j = find_path(flat, flat)
    assert len(i) == len(j) == 0
