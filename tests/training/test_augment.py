from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from everplace.training.augment import Augmentation, augment, augmentation_rng

ALL = Augmentation(shift=0.1, crop=0.2, brightness=0.2, contrast=0.3, blur=1.0)
SHAPES = [(32, 64, 1), (48, 40, 3)]


def picture(shape: tuple[int, int, int]) -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, shape, dtype=np.uint8)


def dot(height: int = 40, width: int = 80) -> NDArray[np.uint8]:
    image = np.zeros((height, width, 1), dtype=np.uint8)
    image[height // 2, width // 2] = 255
    return image


@pytest.mark.parametrize("shape", SHAPES)
def test_same_seed_same_pixels_whatever_the_order(shape: tuple[int, int, int]) -> None:
    image = picture(shape)
    forwards = [augment(image, ALL, augmentation_rng(1, 2, index)) for index in range(6)]
    backwards = [augment(image, ALL, augmentation_rng(1, 2, index)) for index in reversed(range(6))]
    for first, second in zip(forwards, reversed(backwards), strict=True):
        np.testing.assert_array_equal(first, second)


def test_seed_epoch_and_index_all_matter() -> None:
    keys = [(1, 2, 3), (2, 2, 3), (1, 3, 3), (1, 2, 4), (1, 3, 2), (2, 1, 3), (0, 0, 0), (2**63, 2**31, 2**31)]
    assert len({augmentation_rng(*key).random() for key in keys}) == len(keys)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("change", ["shift", "crop", "brightness", "contrast", "blur"])
def test_each_change_keeps_shape_and_type_and_leaves_the_input(shape: tuple[int, int, int], change: str) -> None:
    image = picture(shape)
    before = image.copy()
    image.flags.writeable = False
    changed = augment(image, Augmentation(**{change: 0.5}), augmentation_rng(0, 0, 4))
    assert changed.shape == shape
    assert changed.dtype == np.uint8
    assert (changed != before).any()
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("shape", SHAPES)
def test_nothing_switched_on_is_the_identity_and_a_copy(shape: tuple[int, int, int]) -> None:
    image = picture(shape)
    same = augment(image, Augmentation(), augmentation_rng(0, 0, 0))
    np.testing.assert_array_equal(same, image)
    assert not np.shares_memory(same, image)


def test_shift_moves_evenly_up_to_the_fraction_and_no_further() -> None:
    height, width = 40, 80
    down, right = np.mgrid[:height, :width].astype(np.float64)
    moves = []
    for index in range(300):
        moved = augment(dot(height, width), Augmentation(shift=0.1), augmentation_rng(3, 0, index))[:, :, 0]
        centre = [float((axis * moved).sum() / moved.sum()) for axis in (down, right)]
        moves.append((centre[0] - height // 2, centre[1] - width // 2))
    rows, columns = np.array(moves).T
    for moved, largest in ((rows, 4.0), (columns, 8.0)):
        # A bilinear centre is off by some hundredths of a pixel.
        assert np.abs(moved).max() <= largest + 0.05
        assert moved.min() < -0.95 * largest
        assert moved.max() > 0.95 * largest
        assert abs(moved.mean()) < 0.1 * largest
        assert np.abs(moved - moved.round()).max() > 0.3


def test_what_comes_in_mirrors_the_border() -> None:
    flat = np.full((32, 64, 3), 90, dtype=np.uint8)
    for index in range(20):
        changed = augment(flat, Augmentation(shift=0.4, crop=0.4), augmentation_rng(0, 0, index))
        np.testing.assert_array_equal(changed, flat)


def test_crop_only_enlarges_what_is_inside() -> None:
    ramp = np.tile(np.arange(0, 200, 2, dtype=np.uint8), (100, 1))[:, :, None]
    steps = []
    for index in range(50):
        row = augment(ramp, Augmentation(crop=0.5), augmentation_rng(0, 0, index))[50, 5:-5, 0].astype(float)
        steps.append(np.polyfit(np.arange(len(row)), row, 1)[0])
    assert 1.0 <= min(steps) < 1.2
    assert 1.8 < max(steps) <= 2.01


def test_brightness_and_contrast_stay_in_their_bounds() -> None:
    middle = np.full((4, 4, 1), 127, dtype=np.uint8)
    levels = [
        int(augment(middle, Augmentation(brightness=0.2), augmentation_rng(0, 0, i))[0, 0, 0]) for i in range(200)
    ]
    assert 127 - 52 <= min(levels) < 127 - 40
    assert 127 + 40 < max(levels) <= 127 + 52
    two = np.array([[[77], [178]]], dtype=np.uint8)
    for index in range(100):
        low, high = augment(two, Augmentation(contrast=0.5), augmentation_rng(0, 0, index)).ravel().tolist()
        assert abs((low + high) - 255) <= 1
        assert 50 <= high - low <= 152


def test_brightness_saturates_and_never_wraps() -> None:
    bright = np.full((4, 4, 3), 250, dtype=np.uint8)
    for index in range(50):
        changed = augment(bright, Augmentation(brightness=1.0, contrast=1.0), augmentation_rng(0, 0, index))
        assert np.ptp(changed) == 0
    lifted = [augment(bright, Augmentation(brightness=0.1), augmentation_rng(0, 0, i))[0, 0, 0] for i in range(50)]
    assert min(lifted) >= 224
    assert max(lifted) == 255


def test_blur_softens_and_keeps_the_sum() -> None:
    peaks = []
    for index in range(50):
        blurred = augment(dot(), Augmentation(blur=2.0), augmentation_rng(0, 0, index))
        peaks.append(int(blurred.max()))
        assert abs(int(blurred.sum()) - 255) < 50
    assert min(peaks) < 30
    assert max(peaks) > 200


def test_switching_one_change_on_leaves_the_others_as_they_were() -> None:
    image = picture((32, 64, 1))
    shifted = augment(image, Augmentation(shift=0.2), augmentation_rng(0, 0, 9))
    both = augment(image, Augmentation(shift=0.2, blur=1e-6), augmentation_rng(0, 0, 9))
    np.testing.assert_array_equal(both, shifted)


@pytest.mark.parametrize("wrong", [{"shift": 1.0}, {"crop": -0.1}, {"blur": float("nan")}, {"hue": 0.1}])
def test_amounts_that_cannot_be_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Augmentation(**wrong)
