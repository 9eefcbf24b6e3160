"""Normalised pixels against the formula, channel by channel."""

from __future__ import annotations

import numpy as np
import pytest

from everplace.describe.pretrained.network_input import IMAGENET, Normalisation, network_input
from everplace.errors import ConfigError


def test_imagenet_normalisation_has_its_known_ends() -> None:
    images = np.zeros((2, 4, 6, 3), np.uint8)
    images[1] = 255
    values = network_input(images, IMAGENET)
    assert values.shape == (2, 3, 4, 6)
    assert values.dtype == np.float32
    assert values.flags.c_contiguous
    # What torchvision's Normalize gives for black and for white.
    assert np.allclose(values[0, :, 0, 0], [-2.117904, -2.035714, -1.804444], atol=1e-6)
    assert np.allclose(values[1, :, 3, 5], [2.248908, 2.428571, 2.64], atol=1e-6)


def test_every_pixel_goes_where_it_belongs() -> None:
    images = np.random.default_rng(0).integers(0, 256, (2, 3, 5, 3), dtype=np.uint8)
    before = images.copy()
    values = network_input(images, Normalisation((0.1, 0.2, 0.3), (0.5, 1.0, 2.0)))
    for b, y, x, c in np.ndindex(images.shape):
        expected = (float(images[b, y, x, c]) / 255 - (0.1, 0.2, 0.3)[c]) / (0.5, 1.0, 2.0)[c]
        assert abs(values[b, c, y, x] - expected) < 1e-6
    assert (images == before).all()


def test_one_number_holds_for_all_channels() -> None:
    images = np.random.default_rng(1).integers(0, 256, (1, 2, 2, 3), dtype=np.uint8)
    one = network_input(images, Normalisation((0.5,), (0.25,)))
    assert (one == network_input(images, Normalisation((0.5,) * 3, (0.25,) * 3))).all()


@pytest.mark.parametrize(("mean", "std"), [(0.0, 0.0), (float("nan"), 1.0), (0.0, float("inf"))])
def test_numbers_without_sense_are_refused(mean: float, std: float) -> None:
    with pytest.raises(ConfigError, match="must be finite, and std not 0"):
        Normalisation((mean,), (std,))
