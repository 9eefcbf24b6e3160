"""SAD against a slow patch normalisation, and what it must not care about."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.describe.methods.sad import SAD, normalise_patches


def random_images(count: int, low: int = 0, high: int = 256) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(low, high, (count, 32, 64, 1), dtype=np.uint8)


def test_every_patch_is_normalised_on_its_own() -> None:
    images = random_images(3)
    expected = np.empty((3, 32, 64))
    for b in range(3):
        for y in range(0, 32, 8):
            for x in range(0, 64, 8):
                patch = images[b, y : y + 8, x : x + 8, 0].astype(np.float64)
                expected[b, y : y + 8, x : x + 8] = (patch - patch.mean()) / patch.std()
    described = SAD().describe_batch(images)
    assert described.dtype == np.float32
    assert described.shape == (3, 2048)
    assert np.allclose(described, expected.reshape(3, 2048), atol=1e-6)


def test_a_flat_patch_becomes_zero_and_nothing_else_does() -> None:
    images = random_images(1)
    images[0, 8:16, 24:32] = 77
    described = SAD().describe_batch(images).reshape(32, 64)
    assert (described[8:16, 24:32] == 0).all()
    assert np.isfinite(described).all()
    patches = described.reshape(4, 8, 8, 8).std(axis=(1, 3))
    assert np.count_nonzero(patches < 0.99) == 1


@pytest.mark.parametrize("value", [0, 1, 254, 255])
def test_a_flat_image_becomes_zero(value: int) -> None:
    assert (SAD().describe_batch(np.full((1, 32, 64, 1), value, np.uint8)) == 0).all()


def test_the_largest_contrast_does_not_overflow() -> None:
    images = np.zeros((1, 32, 64, 1), np.uint8)
    images[0, :, ::2] = 255
    assert set(SAD().describe_batch(images).ravel().tolist()) == {-1.0, 1.0}
    lone = np.full((1, 32, 32), 255, np.uint8)
    lone[0, 0, 0] = 0
    normalised = normalise_patches(lone, 32)[0]
    assert normalised[0, 0] == pytest.approx(-np.sqrt(1023), rel=1e-5)


def test_brightness_and_contrast_of_a_patch_do_not_count() -> None:
    images = random_images(2, high=100)
    brighter = images.copy()
    brighter[:, :8, :8] = 2 * images[:, :8, :8] + 50
    assert np.allclose(SAD().describe_batch(brighter), SAD().describe_batch(images), atol=1e-6)


def test_the_batch_does_not_change_the_result() -> None:
    images = random_images(9)
    whole = SAD().describe_batch(images)
    assert (np.vstack([SAD().describe_batch(images[i : i + 1]) for i in range(9)]) == whole).all()
    assert (SAD().describe_batch(images[::-1])[::-1] == whole).all()
