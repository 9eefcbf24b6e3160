"""Other light, weather and season as operations on images: what each may and may not change."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.adaptation.other_light import CHANGES, changed

NAMES = [change.__name__.strip("_") for change in CHANGES]


def views(count: int, channels: int, seed: int = 0) -> NDArray[np.uint8]:
    """Smooth structures of middling brightness with fine texture, N×32×64×C."""
    rng = np.random.default_rng(seed)
    out = np.empty((count, 32, 64, channels), np.uint8)
    for image in out:
        coarse = cv2.resize(rng.uniform(60, 160, (4, 8, channels)), (64, 32), interpolation=cv2.INTER_CUBIC)
        image[:] = coarse.reshape(32, 64, channels) + rng.uniform(-20, 20, (32, 64, channels))
    return out


def under(name: str, images: NDArray[np.uint8], first: int = 0) -> NDArray[np.uint8]:
    return list(changed(images, first))[NAMES.index(name)]


def texture(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Mean size of a pixel's difference to the one beside it, for each image."""
    found: NDArray[np.float64] = np.abs(np.diff(images.astype(float), axis=2)).mean(axis=(1, 2, 3))
    return found


@pytest.mark.parametrize("channels", [1, 3])
def test_every_change_gives_other_images_of_the_same_kind(channels: int) -> None:
    images = views(3, channels)
    given = images.copy()
    found = list(changed(images))
    assert len(found) == len(CHANGES) == len(set(NAMES))
    for name, others in zip(NAMES, found, strict=True):
        assert others.shape == images.shape
        assert others.dtype == np.uint8
        assert all((other != image).any() for other, image in zip(others, images, strict=True)), name
    np.testing.assert_array_equal(images, given)


@pytest.mark.parametrize("cut", [1, 3])
def test_blocks_may_be_cut_anywhere(cut: int) -> None:
    images = views(4, 1)
    parts = zip(changed(images[:cut], 7), changed(images[cut:], 7 + cut), strict=True)
    for whole, (first, second) in zip(changed(images, 7), parts, strict=True):
        np.testing.assert_array_equal(whole, np.concatenate([first, second]))


def test_two_images_are_changed_in_two_ways() -> None:
    images = np.repeat(views(1, 1), 2, axis=0)
    for others in changed(images):
        assert (others[0] != others[1]).any()


def test_another_exposure_keeps_what_is_brighter() -> None:
    images = views(20, 1)
    for image, other in zip(images, under("brightness", images), strict=True):
        order = np.argsort(image, axis=None, kind="stable")
        assert (np.diff(other.ravel()[order].astype(int)) >= 0).all()


def test_glare_scales_until_it_burns_out() -> None:
    images = views(20, 1)
    for image, other in zip(images, under("glare", images), strict=True):
        bright = other < 255
        ratio = other[bright].astype(float).sum() / image[bright].sum()
        assert 0.73 < ratio < 2.72
        np.testing.assert_allclose(other, np.clip(image * ratio, 0, 255), atol=1.5)


def test_grain_has_the_deviation_of_a_sensor() -> None:
    images = np.full((10, 64, 128, 1), 128, np.uint8)
    noise = under("grain", images).astype(float) - 128
    assert noise.std() == pytest.approx(0.02 * 255, rel=0.05)
    assert abs(noise.mean()) < 0.1


def test_a_shadow_varies_smoothly() -> None:
    images = np.full((10, 64, 128, 1), 100, np.uint8)
    shaded = under("shadow", images)
    assert (shaded.std(axis=(1, 2, 3)) > 5).all()
    assert np.abs(np.diff(shaded.astype(int), axis=2)).max() <= 20


def test_haze_takes_contrast() -> None:
    images = views(30, 1)
    assert texture(under("haze", images)).mean() < 0.8 * texture(images).mean()


def test_a_moved_camera_sees_the_same_a_little_elsewhere() -> None:
    images = views(30, 3)
    moved = under("viewpoint", images)
    np.testing.assert_allclose(moved.mean(axis=(1, 2)), images.mean(axis=(1, 2)), atol=12)
    assert (np.abs(moved.astype(int) - images).mean(axis=(1, 2, 3)) > 1).mean() > 0.9


def test_snow_whitens_the_ground_and_takes_its_texture() -> None:
    images = views(40, 1)
    snowed = under("snow", images)
    ground, sky = np.s_[:, 22:], np.s_[:, :8]
    assert texture(snowed[ground]).mean() < 0.6 * texture(images[ground]).mean()
    assert snowed[ground].mean() > images[ground].mean() + 40
    np.testing.assert_allclose(snowed[sky].mean(axis=(1, 2, 3)), images[sky].mean(axis=(1, 2, 3)), atol=5)
