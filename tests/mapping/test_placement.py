"""Where the frames of a new drive belong."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.mapping.placement import agreement, believed, pairs_by_name, pairs_by_pose, placed
from everplace.mapping.self_teaching import SurePairs

PLACES, POSITIONS = np.array([10, 11, 14, 15, 16, 20]), np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])


def pairs(columns: list[int]) -> SurePairs:
    """Of the map's column for each frame; -1: not sure."""
    every = np.array(columns)
    frames = np.flatnonzero(every >= 0)
    return SurePairs(frames, every[frames], np.full(len(frames), 3, np.float32), len(every))


def test_names_pair_by_what_they_are() -> None:
    found = pairs_by_name(["3", "x", "1"], ["1", "2", "3"])
    assert (found.frames.tolist(), found.places.tolist(), found.of) == ([0, 2], [2, 0], 3)


def poses(*rows: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.array(rows, float)


def test_poses_pair_with_the_nearest_within_ten_metres() -> None:
    known = poses((0, 0, 0), (np.nan,) * 3, (30, 0, 0))
    found = pairs_by_pose(poses((1, 1, 0), (20.5, 0, 0), (np.nan,) * 3, (19.5, 0, 0), (0, 10, 3)), known)
    assert found.frames.tolist() == [0, 1, 4]
    assert found.places.tolist() == [0, 2, 0]
    assert found.of == 5


@pytest.mark.parametrize("side", [0, 1])
def test_poses_that_nobody_has_are_said_to_be_missing(side: int) -> None:
    sides = [poses((0, 0, 0)), poses((0, 0, 0))]
    sides[side][:] = np.nan
    with pytest.raises(MapError, match="`align` poses needs poses of the map and of the drive; align by images"):
        pairs_by_pose(*sides)


@pytest.mark.parametrize(
    ("named", "share"),
    [
        ([0, 1, 2, 3], 1.0),
        ([1, 2, 3, 4], 1.0),  # a place off is the frame's neighbour
        ([2, 3, 4, 5], 0.0),
        ([0, 1, -1, -1], 0.5),
        ([-1, -1, -1, -1], None),
    ],
)
def test_agreement_is_of_the_sure_matches(named: list[int], share: float | None) -> None:
    assert agreement(pairs(named), pairs([0, 1, 2, 3])) == share


def test_without_sure_matches_nobody_knows_and_nothing_is_believed() -> None:
    share = agreement(pairs([0, 1]), pairs([-1, -1]))
    assert share is None
    assert not believed(share)
    assert not believed(0.89)
    assert believed(0.9)


def test_sure_frames_get_the_place_of_their_column() -> None:
    found = placed(pairs([0, 2, 5]), PLACES, POSITIONS, "images", 0.5)
    assert found.places.tolist() == [10, 14, 20]
    assert found.positions.tolist() == [0, 2, 5]
    assert found.sure.all()
    assert (found.how, found.agreement, found.new) == ("images", 0.5, 0)


def test_unsure_frames_between_neighbours_get_no_place_but_are_known_to_lie_there() -> None:
    found = placed(pairs([1, -1, -1, 4]), PLACES, POSITIONS, "images")
    assert found.places.tolist() == [11, -1, -1, 16]
    assert np.isnan(found.positions[1:3]).all()
    assert found.between.tolist() == [-1, 14, 15, -1]  # places, not columns
    assert found.new == 0


def test_a_drive_back_lies_between_too() -> None:
    assert placed(pairs([4, -1, -1, 1]), PLACES, POSITIONS, "images").between.tolist() == [-1, 15, 14, -1]


def test_unsure_frames_at_the_ends_and_in_a_jump_are_new_places_behind_the_map() -> None:
    found = placed(pairs([-1, 0, -1, 7, -1]), np.arange(30, 38), np.arange(8.0), "images")
    assert found.places.tolist() == [38, 30, 39, 37, 40]
    assert found.positions.tolist() == [8, 0, 9, 7, 10]
    assert found.sure.tolist() == [False, True, False, True, False]
    assert found.new == 3


@pytest.mark.parametrize("frames", [9, 10, 30])
@pytest.mark.parametrize("seen", [True, False])
def test_a_long_detour_between_neighbours_is_told_from_frames_that_are_hard(frames: int, seen: bool) -> None:
    """Hard frames look a little like where they are; the detour like nothing, though the road goes on behind it."""
    count = 60
    rng = np.random.default_rng(frames)
    scores = (rng.normal(0, 0.1, (frames + 2, count)) + rng.normal(0, 0.3, count)).astype(np.float32)
    line = 10 + np.arange(frames + 2)
    if seen:
        scores[np.arange(frames + 2), line + np.arange(frames + 2) % 3 - 1] += 0.35
    hard = pairs([10, *[-1] * frames, 10 + frames + 1])
    found = placed(hard, np.arange(count), np.arange(float(count)), "images", None, scores)
    if seen or frames < 10:
        assert found.between[1:-1].tolist() == line[1:-1].tolist()
        assert found.new == 0
    else:
        assert found.places[1:-1].tolist() == [*range(60, 60 + frames)]
        assert found.new == frames


def test_a_drive_that_matches_nothing_is_all_new() -> None:
    found = placed(pairs([-1, -1, -1]), PLACES, POSITIONS, "images")
    assert found.places.tolist() == [21, 22, 23]
    assert not found.sure.any()
    assert (found.between == -1).all()
