"""Resampled drives: what they hold, and that they can be had again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from studies.resample import resample_drive

from everplace.errors import ConfigError


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 300), st.integers(0, 99), st.sampled_from([0.0, 0.05]), st.integers(0, 3))
def test_it_goes_from_the_first_frame_to_the_last(count: int, seed: int, reverse: float, jumps: int) -> None:
    drive = resample_drive(count, seed, reverse=reverse, jumps=jumps)
    assert drive.dtype == np.int64
    assert drive[0] == 0
    assert drive[-1] == count - 1
    assert ((drive >= 0) & (drive < count)).all()
    np.testing.assert_array_equal(drive, resample_drive(count, seed, reverse=reverse, jumps=jumps))


def test_another_seed_is_another_drive() -> None:
    first, second = resample_drive(200, 0), resample_drive(200, 1)
    assert len(first) != len(second) or (first != second).any()


def test_an_even_speed_without_stops_takes_every_frame() -> None:
    np.testing.assert_array_equal(resample_drive(50, 3, speeds=(1.0, 1.0), stop=0.0), np.arange(50))


def test_speeds_stay_within_their_bounds_and_vary() -> None:
    drive = resample_drive(4000, 5, stop=0.0)
    assert set(np.diff(drive).tolist()) == {0, 1, 2}
    travelled = drive[20:] - drive[:-20]
    assert travelled.min() >= 20 * 0.7 - 1
    assert travelled.max() <= 20 * 1.4 + 1
    assert travelled.max() - travelled.min() > 8


def test_stops_last_as_long_as_they_are_asked_to() -> None:
    drive = resample_drive(2000, 6, speeds=(1.0, 1.0), stop=0.05, stop_frames=(3, 8))
    lengths = np.unique(drive, return_counts=True)[1]
    assert set(lengths.tolist()) <= {1, 3, 4, 5, 6, 7, 8}
    assert lengths.max() == 8
    assert 0.02 < (lengths > 1).mean() < 0.1


def test_reverse_and_jumps_are_in_the_drive() -> None:
    steps = np.diff(resample_drive(500, 7, stop=0.0, reverse=0.02))
    assert steps.min() < 0
    assert np.abs(steps).max() <= 2
    jumps = np.abs(np.diff(resample_drive(500, 7, stop=0.0, jumps=3)))
    assert 1 <= (jumps > 2).sum() <= 3


@pytest.mark.parametrize(("count", "speeds"), [(1, (0.7, 1.4)), (9, (0.0, 1.0)), (9, (2.0, 1.0))])
def test_a_drive_that_cannot_be_is_refused(count: int, speeds: tuple[float, float]) -> None:
    with pytest.raises(ConfigError, match="cannot be driven"):
        resample_drive(count, 0, speeds=speeds)
