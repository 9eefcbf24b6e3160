from __future__ import annotations

import numpy as np
import pytest

from everplace.render.camera import Camera

LEVEL = Camera(x=10.0, y=5.0, z=2.0, heading=np.pi / 2, pitch=0.0, height=100, width=200)


def test_a_point_straight_ahead_falls_on_the_horizon_in_the_middle() -> None:
    pixel = LEVEL.project(LEVEL.local(np.array([10.0, 55.0, 2.0])))
    np.testing.assert_allclose(pixel, [100.0, 46.0])


def test_right_and_up_have_the_sign_of_an_image() -> None:
    # Looking along +y, +x is to the right. Focal length 0.44 * 300 = 132 pixels, so 1 m at 10 m is 13.2 pixels.
    pixel = LEVEL.project(LEVEL.local(np.array([11.0, 15.0, 3.0])))
    np.testing.assert_allclose(pixel, [113.2, 46 - 13.2])


def test_ground_points_are_the_inverse_of_projection() -> None:
    camera = Camera(3.0, -4.0, 1.9, 0.4, 0.02, 64, 128)
    depth = np.array([[5.0], [40.0]], np.float32)
    x, y = camera.ground_points(depth, camera.column_slopes()[None])
    points = np.stack([x, y, np.full_like(x, 1.0)], axis=-1).astype(np.float64)
    pixels = camera.project(camera.local(points))
    np.testing.assert_allclose(pixels[..., 0], np.broadcast_to(np.arange(128) + 0.5, (2, 128)), atol=1e-3)


def test_rows_of_slopes_agree_with_projection() -> None:
    camera = Camera(0.0, 0.0, 2.0, 0.0, 0.05, 64, 128)
    slope = float(camera.row_slopes()[20])
    row = camera.project(np.array([0.0, 7 * slope, 7.0]))[1]
    assert row == pytest.approx(20.5, abs=1e-4)
