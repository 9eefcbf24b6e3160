from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.alignment import drive_path as path_module
from everplace.alignment.drive_path import find_path, thin
from everplace.alignment.judgement import crooked, judge_path, rivals
from everplace.describe.files.descriptors import Descriptors


def described(values: NDArray[np.floating]) -> Descriptors:
    return Descriptors(values.astype(np.float32), tuple(map(str, range(len(values)))), "test")


def test_a_path_without_rivals_is_sure() -> None:
    rng = np.random.default_rng(0)
    world = rng.normal(size=(120, 64))
    first, second = (described(world + 0.5 * rng.normal(size=world.shape)) for _ in range(2))
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


def test_long_drives_are_judged_by_every_so_many_th_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    world = np.cumsum(rng.normal(size=(240, 64)), axis=0)
    first, second = described(world), described(world[20:] + 0.3 * rng.normal(size=(220, 64)))
    monkeypatch.setattr(path_module, "_MOST_FRAMES", 60)
    pairs = np.arange(20, 240), np.arange(220)
    judged = judge_path(thin(first), thin(second), pairs)
    assert judged.strides == (4, 4)
    assert judged.S.shape == (60, 55)
    assert len(judged.unsure) == 220
    assert not judged.by_chance
    assert not judged.unsure.any()
