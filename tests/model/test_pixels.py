"""Pixels to network input and back."""

from __future__ import annotations

import numpy as np
import torch

from everplace.model.pixels import to_input, to_pixels


def test_input_is_channels_first_in_0_to_1() -> None:
    pixels = np.zeros((2, 3, 4, 3), dtype=np.uint8)
    pixels[1, 2, 0] = (255, 51, 0)
    images = to_input(torch.from_numpy(pixels))
    assert images.shape == (2, 3, 3, 4)
    assert images.dtype == torch.float32
    assert images.is_contiguous()
    torch.testing.assert_close(images[1, :, 2, 0], torch.tensor([1.0, 0.2, 0.0]))
    assert images.sum() == images[1, :, 2, 0].sum()


def test_pixels_survive_the_round_trip() -> None:
    pixels = np.arange(256, dtype=np.uint8).reshape(2, 8, 16, 1)
    assert np.array_equal(to_pixels(to_input(torch.from_numpy(pixels))), pixels)


def test_what_a_decoder_puts_out_of_range_is_clipped() -> None:
    images = torch.tensor([-3.0, 0.4999, 7.0]).view(1, 1, 1, 3).requires_grad_()
    assert to_pixels(images).ravel().tolist() == [0, 127, 255]
