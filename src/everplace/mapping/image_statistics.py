"""32 numbers that tell how a frame looks, not what is in it: brightness, contrast, fine structure and colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["STATISTICS", "image_statistics", "shows_nothing"]

_BANDS = 4
STATISTICS = 8 * _BANDS
_GREY = np.array([0.299, 0.587, 0.114], np.float32)
_DARKEST = np.float32(0.003)
"""Added before a logarithm: about one step of 8 bits."""
_BLANK = np.float32(4 / 255)
"""Range of the grey values in a band below which it shows nothing."""


def image_statistics(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Measures frames in four bands from the top: sky, horizon, and what lies before the camera.

    Eight numbers a band: mean grey; the grey value that 5 % and 95 % of the pixels stay below; the logarithms of the
    median step and of the mean step from a pixel to its right neighbour (noise, and edges with it); means of red less
    green and of blue less yellow; and the logarithm of how much these two vary. A grey frame has no colour: its last
    three are those of grey pixels.

    Args:
        images: B×H×W×C, C 1 (grey) or 3 (RGB), H at least 4 and W at least 2.

    Returns:
        B×32.
    """
    pixels = images.astype(np.float32) / 255
    if pixels.shape[-1] == 1:
        pixels = np.repeat(pixels, 3, axis=-1)
    numbers: list[NDArray[np.float32]] = []
    for band in np.array_split(pixels, _BANDS, axis=1):
        grey = band @ _GREY
        flat = grey.reshape(len(grey), -1)
        steps = np.abs(np.diff(grey, axis=2)).reshape(len(grey), -1)
        red_green = band[..., 0] - band[..., 1]
        blue_yellow = band[..., 2] - (band[..., 0] + band[..., 1]) / 2
        numbers += [
            flat.mean(axis=1),
            *np.quantile(flat, (0.05, 0.95), axis=1),
            np.log(np.median(steps, axis=1) + _DARKEST),
            np.log(steps.mean(axis=1) + _DARKEST),
            red_green.mean(axis=(1, 2)),
            blue_yellow.mean(axis=(1, 2)),
            np.log((red_green.std(axis=(1, 2)) + blue_yellow.std(axis=(1, 2))) / 2 + _DARKEST),
        ]
    return np.stack(numbers, axis=1).astype(np.float32)


def shows_nothing(statistics: NDArray[np.float32]) -> bool:
    """Whether a frame is of one grey nearly everywhere, as with a covered lens; its noise is no place.

    Args:
        statistics: (32,) of `image_statistics`.
    """
    bands = statistics.reshape(_BANDS, -1)
    return bool((bands[:, 2] - bands[:, 1] < _BLANK).all())
