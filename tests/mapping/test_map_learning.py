"""What a map learns where its drives do not show each other's places."""

from __future__ import annotations

import numpy as np
import pytest

from everplace.adaptation.moments import Moments
from everplace.mapping.map_learning import Learnt, MapFrames, learn


def learnt(drives: list[int]) -> Learnt:
    """Of a map with 150 places: each is shown by two frames in a row, of these drives."""
    rng = np.random.default_rng(0)
    looks = rng.normal(size=(150, 24))
    count = 300 * len(drives)
    places = np.tile(np.repeat(np.arange(150), 2), len(drives))
    features = (looks[places] + 0.3 * rng.normal(size=(count, 24))).astype(np.float16)
    of_drives = np.repeat(drives, 300)
    frames = MapFrames(
        features, of_drives, places, places.astype(float), np.ones(count, np.bool_), np.full(count, -1), [True, True]
    )
    return learn(frames, Moments.none(24), 8, None)


@pytest.mark.parametrize("drive", [0, 1])
def test_pairs_of_one_drive_with_itself_calibrate_nothing(drive: int) -> None:
    """As of a slow second drive, after the first one was removed."""
    alone = learnt([drive])
    assert alone.known["pairs"] == 150
    assert alone.calibration.provisional
    assert len(alone.held_out.probability) == 0


def test_two_drives_that_show_the_same_places_calibrate_the_map() -> None:
    both = learnt([0, 1])
    assert not both.calibration.provisional
    assert both.held_out.on_map.mean() == pytest.approx(7 / 8, abs=0.05)
    assert both.held_out.right[both.held_out.on_map].mean() > 0.9
