from __future__ import annotations

import numpy as np
import pytest

from everplace.mapping.image_statistics import STATISTICS, image_statistics, shows_nothing

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("size", [(64, 128), (33, 65), (4, 2)])
@pytest.mark.parametrize("channels", [1, 3])
def test_frames_of_any_size_have_as_many_numbers(size: tuple[int, int], channels: int) -> None:
    images = RNG.integers(0, 256, (3, *size, channels), np.uint8)
    values = image_statistics(images)
    assert values.shape == (3, STATISTICS)
    assert values.dtype == np.float32
    assert np.isfinite(values).all()
    assert np.allclose(image_statistics(images[1:2])[0], values[1], atol=1e-6)


def test_a_grey_frame_is_one_of_grey_pixels() -> None:
    grey = RNG.integers(0, 256, (2, 16, 16, 1), np.uint8)
    assert np.allclose(image_statistics(grey), image_statistics(np.repeat(grey, 3, axis=-1)), atol=1e-5)


def test_numbers_are_those_of_their_band() -> None:
    image = np.zeros((1, 64, 128, 3), np.uint8)
    image[:, :16] = (0, 0, 255)  # a blue sky
    image[:, 48:, ::2] = 255  # stripes before the camera
    sky, horizon, middle, road = image_statistics(image)[0].reshape(4, 8)
    assert np.array_equal(horizon, middle)
    assert horizon[:3].tolist() == [0, 0, 0]
    assert sky[0] == pytest.approx(0.114, abs=1e-6)
    assert sky[6] == pytest.approx(1)
    assert road[0] == pytest.approx(0.5, abs=1e-3)
    assert road[1:3].tolist() == pytest.approx([0, 1], abs=1e-3)
    assert road[3] == road[4] == pytest.approx(np.log(1.003), abs=1e-4)
    assert road[5:7].tolist() == pytest.approx([0, 0], abs=1e-6)


def test_darkness_and_noise_are_told() -> None:
    image = RNG.integers(100, 140, (1, 32, 32, 3), np.uint8)
    dark = image_statistics(image // 4)[0].reshape(4, 8)
    light = image_statistics(image)[0].reshape(4, 8)
    smooth = image_statistics(np.full_like(image, 120))[0].reshape(4, 8)
    assert (dark[:, 0] < light[:, 0]).all()
    assert (smooth[:, 3] < light[:, 3]).all()


@pytest.mark.parametrize("grey", [0, 7, 128, 255])
def test_one_grey_with_a_little_noise_shows_nothing(grey: int) -> None:
    noise = np.random.default_rng(0).integers(-1, 2, (1, 64, 128, 3))
    frame = np.clip(grey + noise, 0, 255).astype(np.uint8)
    assert shows_nothing(image_statistics(frame)[0])
    frame[:, 40:60] = np.linspace(0, 30, 128).astype(np.uint8)[:, None]
    assert not shows_nothing(image_statistics(frame)[0])
