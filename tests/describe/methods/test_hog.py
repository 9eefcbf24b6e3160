"""HOG against a slow computation of the same histograms, and ramps whose gradient is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.describe.methods.hog import HOG


def slow_hog(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Blocks × (2 columns × 2 rows of cells × 9 bins) of a 64×128 grey image, in double precision.

    Central differences; the gradient's length is shared between the two nearest orientations and the four nearest
    cells, under a Gaussian of a quarter of the block's size; each block is normalised, cut at 0.2 and normalised
    again. Blocks and cells run column by column, as OpenCV orders them.
    """
    padded = np.pad(image.astype(np.float64), 1, mode="reflect")
    dx = padded[1:-1, 2:] - padded[1:-1, :-2]
    dy = padded[2:, 1:-1] - padded[:-2, 1:-1]
    length = np.hypot(dx, dy)
    orientation = np.mod(np.arctan2(dy, dx), np.pi) / np.pi * 9 - 0.5
    blocks = []
    for left in range(0, 128 - 15, 8):
        for top in range(0, 64 - 15, 8):
            cells = np.zeros((2, 2, 9))
            for y in range(16):
                for x in range(16):
                    weight = np.exp(-((x - 8) ** 2 + (y - 8) ** 2) / (2 * 4.0**2)) * length[top + y, left + x]
                    low = int(np.floor(orientation[top + y, left + x]))
                    share = orientation[top + y, left + x] - low
                    for column in range(2):
                        for row in range(2):
                            near = max(0.0, 1 - abs((x + 0.5) / 8 - 0.5 - column))
                            near *= max(0.0, 1 - abs((y + 0.5) / 8 - 0.5 - row))
                            cells[column, row, low % 9] += weight * near * (1 - share)
                            cells[column, row, (low + 1) % 9] += weight * near * share
            block = cells.ravel() / (np.linalg.norm(cells) + 36 * 0.1)
            block = np.minimum(block, 0.2)
            blocks.append(block / (np.linalg.norm(block) + 1e-3))
    return np.array(blocks)


def describe(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    return HOG().describe_batch(image[None, :, :, None]).reshape(-1)


def test_it_is_the_slow_computation() -> None:
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (8, 16)).astype(np.uint8)
    image = np.kron(coarse, np.ones((8, 8), np.uint8)) // 2 + rng.integers(0, 64, (64, 128), dtype=np.uint8)
    assert np.allclose(describe(image).reshape(105, 36), slow_hog(image), atol=5e-4)


def test_it_has_3780_values_in_blocks_of_length_1() -> None:
    image = np.random.default_rng(1).integers(0, 256, (64, 128), dtype=np.uint8)
    described = describe(image)
    assert described.dtype == np.float32
    assert described.shape == (HOG().dimension,) == (15 * 7 * 4 * 9,)
    assert described.min() >= 0
    assert np.allclose(np.linalg.norm(described.reshape(105, 36), axis=1), 1, atol=2e-3)


def test_a_flat_image_is_zero() -> None:
    assert (describe(np.full((64, 128), 90, np.uint8)) == 0).all()


def test_the_gradient_of_a_vertical_ramp_falls_into_one_bin() -> None:
    # 90 degrees is the middle of the fifth of nine bins: every cell holds it alone, each a half of a block of length 1.
    ramp = np.repeat(np.arange(0, 256, 4, dtype=np.uint8)[:, None], 128, axis=1)
    block = describe(ramp).reshape(15, 7, 4, 9)[7, 3]
    assert np.allclose(block[:, 4], 0.5, atol=0.02)
    assert np.abs(np.delete(block, 4, axis=1)).max() < 1e-4


def test_the_gradient_of_a_horizontal_ramp_is_shared_by_the_outer_bins() -> None:
    # 0 degrees lies on the border between the last bin and the first: 8 equal values, each 1/√8.
    ramp = np.repeat(np.arange(0, 256, 2, dtype=np.uint8)[None, :], 64, axis=0)
    block = describe(ramp).reshape(15, 7, 4, 9)[7, 3]
    assert np.allclose(block[:, [0, 8]], 8**-0.5, atol=0.02)
    assert np.abs(block[:, 1:8]).max() < 1e-4


def test_brightness_does_not_count_and_contrast_hardly() -> None:
    image = np.random.default_rng(2).integers(0, 100, (64, 128), dtype=np.uint8)
    assert (describe(image + 100) == describe(image)).all()
    assert np.allclose(describe(image * 2), describe(image), atol=0.01)


def test_the_negative_picture_looks_the_same() -> None:
    image = np.random.default_rng(3).integers(0, 256, (64, 128), dtype=np.uint8)
    assert np.allclose(describe(255 - image), describe(image), atol=1e-5)


def test_the_batch_does_not_change_the_result() -> None:
    images = np.random.default_rng(4).integers(0, 256, (5, 64, 128, 1), dtype=np.uint8)
    whole = HOG().describe_batch(images)
    assert (np.vstack([HOG().describe_batch(images[i : i + 1]) for i in range(5)]) == whole).all()
    assert (HOG().describe_batch(np.asfortranarray(images)) == whole).all()
