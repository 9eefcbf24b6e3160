"""Augmentation: the small accidents that make two pictures of one place differ within one traverse."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from everplace.settings import Settings

__all__ = ["Augmentation", "augment", "augmentation_rng"]

_Below1 = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]
_UpTo1 = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]


class Augmentation(Settings):
    """How much an image may change; every amount is drawn evenly between none and the value given here."""

    shift: _Below1 = 0.0
    """Largest move to either side, as a fraction of the image's height and width."""
    crop: _Below1 = 0.0
    """Largest fraction of height and width cut away; what is left is enlarged to the whole."""
    brightness: _UpTo1 = 0.0
    """Largest change of brightness up or down, as a fraction of the whole range."""
    contrast: _UpTo1 = 0.0
    """Largest change of the distance from middle grey, as a fraction of that distance."""
    blur: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = 0.0
    """Largest sigma of a Gaussian blur, in pixels."""


def augmentation_rng(seed: int, epoch: int, index: int) -> np.random.Generator:
    """Returns the random numbers of one frame in one epoch, whatever thread or order it is read in.

    Args:
        seed: The run's seed, 0 to 2**64 - 1.
        epoch: 0 to 2**32 - 1.
        index: The frame's position in the training set, 0 to 2**32 - 1.
    """
    # Philox is a counter-based generator: distinct keys give independent streams.
    return np.random.Generator(np.random.Philox(key=(seed << 64) | (epoch << 32) | index))


def augment(image: NDArray[np.uint8], augmentation: Augmentation, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Returns a changed copy of an image.

    What comes in from outside mirrors the border.

    Args:
        image: H×W×C uint8, C = 1 or 3; left as it is.
        augmentation: How much may change.
        rng: Random numbers; eight are always drawn, so switching one change on does not alter the others.

    Returns:
        H×W×C uint8.
    """
    down, right, cut, top, left, brighter, stronger, sigma = rng.random(8).tolist()
    result = image
    if augmentation.shift or augmentation.crop:
        height, width = image.shape[:2]
        kept = 1.0 - augmentation.crop * cut
        # Maps each pixel of the result to one of the source (WARP_INVERSE_MAP); the half pixels keep centres
        # centred.
        x = (1.0 - kept) * left * width + 0.5 * kept - 0.5 - augmentation.shift * width * (2.0 * right - 1.0)
        y = (1.0 - kept) * top * height + 0.5 * kept - 0.5 - augmentation.shift * height * (2.0 * down - 1.0)
        warped = cv2.warpAffine(
            result,
            np.array([[kept, 0.0, x], [0.0, kept, y]]),
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        result = np.asarray(warped, dtype=np.uint8)
    if augmentation.brightness or augmentation.contrast:
        gain = 1.0 + augmentation.contrast * (2.0 * stronger - 1.0)
        offset = 127.5 * (1.0 - gain) + 255.0 * augmentation.brightness * (2.0 * brighter - 1.0)
        # Not convertScaleAbs, which would turn what falls below black bright again.
        result = np.asarray(cv2.addWeighted(result, gain, result, 0.0, offset), dtype=np.uint8)
    if augmentation.blur:
        result = np.asarray(cv2.GaussianBlur(result, (0, 0), max(augmentation.blur * sigma, 1e-3)), dtype=np.uint8)
    return image.copy() if result is image else result.reshape(image.shape)
