"""Which frames a map holds out, which of them are made ones off the map, and what the last ten of them say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.mapping.calibration import PROVISIONAL, likelihood_ratios_of
from everplace.mapping.frame_window import MAP_MODEL
from everplace.mapping.held_out_answers import (
    HeldOutAnswers,
    follows_none,
    sequence_answers,
    some_stretches,
    stretches,
)
from everplace.sequences.belief import Belief

PLACES = 200


def answered(true: NDArray[np.int64], breaks: list[int], away: float = 8.0) -> HeldOutAnswers:
    """Of frames that look like their places; at `breaks` another drive begins."""
    scores = np.random.default_rng(0).normal(size=(len(true), PLACES)).astype(np.float32)
    scores[np.arange(len(true)), true] += away
    apart = np.isin(np.arange(len(true)), [0, *breaks])
    return sequence_answers(scores, true, stretches(apart), apart, PROVISIONAL)


@given(drives=st.lists(st.integers(1, 400), min_size=1, max_size=12))
def test_no_stretch_is_of_two_drives_and_all_but_the_last_of_each_are_whole(drives: list[int]) -> None:
    of = np.repeat(np.arange(len(drives)), drives)
    numbers = stretches(follows_none(np.arange(len(of)), of))
    assert set(np.diff(numbers).tolist()) <= {0, 1}
    for drive, frames in enumerate(drives):
        sizes = np.unique(numbers[of == drive], return_counts=True)[1]
        np.testing.assert_array_equal(sizes[:-1], 24)
        assert sizes.sum() == frames
    assert all(np.ptp(of[numbers == number]) == 0 for number in np.unique(numbers))


def test_after_a_gap_of_a_drive_a_stretch_begins_anew() -> None:
    rows = np.r_[0:30, 40:50, 90:100]
    apart = follows_none(rows, np.zeros(50, np.int64))
    np.testing.assert_array_equal(np.flatnonzero(apart), [0, 40])
    np.testing.assert_array_equal(np.flatnonzero(np.diff(stretches(apart))) + 1, [24, 40])


@given(drives=st.lists(st.integers(1, 3000), min_size=1, max_size=12))
def test_stretches_stay_whole_and_are_not_many(drives: list[int]) -> None:
    of = np.repeat(np.arange(len(drives)), drives)
    numbers = stretches(follows_none(np.arange(len(of)), of))
    kept = some_stretches(numbers, 2000)
    assert set(numbers[kept].tolist()).isdisjoint(numbers[~kept].tolist())
    if len(of) <= 2000:
        assert kept.all()
    else:
        assert 2000 - 24 * len(drives) <= kept.sum() <= 2000 + 24 * len(drives)


@pytest.mark.parametrize("second", [0, 60, 130])
def test_what_is_hidden_is_of_one_drive(second: int) -> None:
    """The first drive has 110 frames, so the fifth stretch is 14 long; the second drive begins elsewhere."""
    held_out = answered(np.r_[0:110, second : second + 40], [110])
    np.testing.assert_array_equal(np.flatnonzero(~held_out.on_map), np.arange(96, 110))
    assert not held_out.right[96:110].any()
    assert held_out.right[held_out.on_map].all()


def test_where_a_drive_closes_a_loop_the_places_between_are_not_hidden() -> None:
    true = np.r_[0:100, 190:200, 0:40]
    held_out = answered(true, [])
    np.testing.assert_array_equal(np.flatnonzero(~held_out.on_map), np.arange(96, 120))
    assert not held_out.right[96:120].any()
    scores = np.zeros((150, PLACES), np.float32)
    scores[np.arange(150), true] = 8
    scores[96:120, 150] = 4  # elsewhere on the map, which a frame off it may look like
    apart = np.arange(150) == 0
    elsewhere = sequence_answers(scores, true, stretches(apart), apart, PROVISIONAL)
    assert elsewhere.probability[110:119].min() > 0.5


def test_a_window_holds_frames_in_a_row_alone() -> None:
    """Frames after a gap, or of another drive, are answered as if nothing had been seen before."""
    rng = np.random.default_rng(0)
    true = np.r_[0:20, 60:80]
    scores = rng.normal(size=(40, 90)).astype(np.float32)
    scores[np.arange(40), true] += 2
    apart = np.isin(np.arange(40), [0, 20])
    held_out = sequence_answers(scores, true, stretches(apart), apart, PROVISIONAL)
    assert held_out.on_map.all()
    for query, first in ((19, 10), (20, 20), (24, 20), (35, 26)):
        belief = Belief.start(MAP_MODEL, 1, 90)
        for number, row in enumerate(scores[first : query + 1]):
            if number:
                belief.move(MAP_MODEL)
            belief.see(likelihood_ratios_of(row, PROVISIONAL))
        posterior = belief.places[0]
        place = int(MAP_MODEL.worth(posterior[None])[0].argmax())
        near = posterior[max(place - 1, 0) : place + 2].sum()
        assert held_out.probability[query] == pytest.approx(near, rel=1e-5)
        assert held_out.right[query] == (abs(place - true[query]) <= 1)
    joined = sequence_answers(scores, true, stretches(apart), np.arange(40) == 0, PROVISIONAL)
    assert joined.probability[20] != pytest.approx(held_out.probability[20])


def test_arrays_bring_it_back_and_those_of_an_earlier_map_count_all_frames() -> None:
    held_out = answered(np.arange(130), [])
    arrays = held_out.to_arrays()
    again = HeldOutAnswers.from_arrays(arrays)
    for name in ("probability", "right", "on_map"):
        np.testing.assert_array_equal(getattr(again, name), getattr(held_out, name))
    del arrays["held_out.on_map"]
    assert HeldOutAnswers.from_arrays(arrays).on_map.all()
