from __future__ import annotations

import numpy as np
import pytest

from everplace.render.noise import TILE, profile, ramp, sample, tile


def test_tile_is_bounded_and_repeats_without_a_seam() -> None:
    texture = tile(np.random.default_rng(0), 8, 3)
    assert texture.shape == (TILE + 1, TILE + 1)
    assert np.abs(texture).max() == pytest.approx(1)
    np.testing.assert_array_equal(texture[0], texture[-1])
    np.testing.assert_array_equal(texture[:, 0], texture[:, -1])
    inner = np.abs(np.diff(texture, axis=0)).max()
    assert np.abs(texture[-1] - texture[-2]).max() <= inner


def test_sample_agrees_with_bilinear_interpolation_by_hand() -> None:
    texture = tile(np.random.default_rng(1), 16, 2)
    x, y = np.array([[10.5, -2.0]], np.float32), np.array([[20.25, 3.0 + TILE * 2.0]], np.float32)
    top = texture[10, 5] * 0.75 + texture[10, 6] * 0.25
    low = texture[11, 5] * 0.75 + texture[11, 6] * 0.25
    expected = [top * 0.875 + low * 0.125, (texture[1, TILE - 1] + texture[2, TILE - 1]) / 2]
    np.testing.assert_allclose(sample(texture, x, y, 2.0)[0], expected, atol=0.01)


def test_sample_repeats_after_a_tile() -> None:
    texture = tile(np.random.default_rng(2), 8, 2)
    x = np.linspace(0, 100, 7, dtype=np.float32)[None]
    np.testing.assert_allclose(sample(texture, x, x, 0.5), sample(texture, x + TILE * 0.5, x - TILE, 0.5), atol=2e-3)


def test_profile_is_smooth_with_unit_spread() -> None:
    values = profile(np.random.default_rng(3), 20_000, 8.0)
    assert len(values) == 20_000
    assert values.std() == pytest.approx(1, abs=0.1)
    assert np.corrcoef(values[:-1], values[1:])[0, 1] > 0.98
    # Smoothing by a Gaussian of width s leaves a correlation of exp(-lag² / 4 s²).
    assert np.corrcoef(values[:-16], values[16:])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)


def test_ramp_rises_from_0_to_1() -> None:
    np.testing.assert_allclose(ramp(np.array([0.0, 2.0, 3.0, 4.0, 9.0], np.float32), 2, 4), [0, 0, 0.5, 1, 1])
