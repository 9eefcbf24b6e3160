from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.alignment import drive_path as path_module
from everplace.alignment.drive_path import contrast, find_path, local_path, thin, thinning
from everplace.describe.files.descriptors import Descriptors

STEP_COST = 0.5
SCORES = arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 6)), elements=st.floats(-4, 4, allow_nan=False))


def described(values: NDArray[np.floating]) -> Descriptors:
    names = tuple(map(str, range(len(values))))
    images = tuple(f"{name}.png" for name in names)
    return Descriptors(values.astype(np.float32), names, "test", image_names=images)


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


def test_nothing_alike_gives_no_pairs_or_few() -> None:
    flat = described(np.ones((5, 3)))
    i, j = find_path(flat, flat)
    assert len(i) == len(j) == 0
