from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.importing.positions.geodesy import local_plane, track_headings


def series(latitude: float) -> tuple[float, float]:
    """Metres a degree to the north and to the east: the published series in multiples of the latitude."""
    phi = np.radians(latitude)
    north = 111_132.92 - 559.82 * np.cos(2 * phi) + 1.175 * np.cos(4 * phi) - 0.0023 * np.cos(6 * phi)
    east = 111_412.84 * np.cos(phi) - 93.5 * np.cos(3 * phi) + 0.118 * np.cos(5 * phi)
    return float(north), float(east)


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
@settings(max_examples=50, deadline=None)
def test_metres_agree_with_the_published_series(latitude: float, longitude: float, up: float, right: float) -> None:
    ((x, y),) = local_plane(np.array([[latitude + up, longitude + right]]), (latitude, longitude))
    north, east = series(latitude)
    assert x == pytest.approx(east * right, abs=0.05)
    assert y == pytest.approx(north * up, abs=0.05)


def test_the_date_line_is_crossed_the_short_way() -> None:
    ((x, _),) = local_plane(np.array([[0.0, -179.999]]), (0.0, 179.999))
    assert x == pytest.approx(0.002 * series(0.0)[1], abs=0.01)


def test_headings_follow_the_track_and_ignore_the_noise_of_a_stop() -> None:
    angle = np.linspace(0, np.pi / 2, 200)
    track = 100 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    np.testing.assert_allclose(track_headings(track), angle, atol=0.02)
    stop = np.concatenate([track, track[-1] + np.random.default_rng(0).normal(0, 0.05, (50, 2))])
    np.testing.assert_allclose(track_headings(stop)[200:], np.pi / 2, atol=0.02)


def test_a_drive_that_never_moves_has_heading_zero() -> None:
    np.testing.assert_array_equal(track_headings(np.zeros((4, 2))), np.zeros(4))
    assert len(track_headings(np.zeros((0, 2)))) == 0
