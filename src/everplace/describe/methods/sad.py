"""SAD: the patch-normalised thumbnail of SeqSLAM, compared by the sum of absolute differences.

Milford and Wyeth, "SeqSLAM: Visual Route-Based Navigation for Sunny Summer Days and Stormy Winter Nights",
ICRA 2012. Frame by frame; SeqSLAM's search for sequences is a separate step (`everplace.sequences.sequence_search`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer, require_no_argument
from everplace.describe.files.descriptors import Settings
from everplace.images.decoding import ImageSpec

__all__ = ["SAD", "normalise_patches", "open_method"]

NOTES = (("sad", "the patch-normalised thumbnail of SeqSLAM, compared by absolute differences", "", 2048),)


class SAD(Describer):
    """Describes an image by its 64×32 (width × height) grey pixels, normalised patch by patch of 8×8."""

    method = "sad"
    image = ImageSpec(size=(32, 64), grey=True)
    dimension = 2048
    metric = "mean-absolute-difference"
    patch = 8

    def settings(self) -> Settings:
        """Returns the side of a patch in pixels."""
        return {"patch": self.patch}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×32×64×1 images by B×2048 values, row by row of the image."""
        return normalise_patches(images[..., 0], self.patch).reshape(len(images), -1)


def open_method(argument: str) -> Describer:
    """Opens SAD, which has no options."""
    require_no_argument("sad", argument)
    return SAD()


def normalise_patches(images: NDArray[np.uint8], patch: int) -> NDArray[np.float32]:
    """Gives every patch mean 0 and (population) standard deviation 1; a flat patch becomes 0.

    With n pixels x in a patch, (x - mean) / deviation = (n x - Σx) / √(n Σx² - (Σx)²): only integers
    before the root, so the result is the same to the last bit in a batch of any size, and a flat patch is
    recognised exactly.

    Args:
        images: B×H×W grey values; H and W are multiples of `patch`.
        patch: Side of a patch in pixels; at most 32, or n Σx² leaves 32 bits.

    Returns:
        B×H×W.
    """
    count, height, width = images.shape
    pixels = images.reshape(count, height // patch, patch, width // patch, patch).astype(np.int32)
    n = patch * patch
    total = pixels.sum(axis=(2, 4), keepdims=True, dtype=np.int32)
    squares = np.square(pixels).sum(axis=(2, 4), keepdims=True, dtype=np.int32)
    spread = n * squares - np.square(total)
    scale = np.sqrt(np.maximum(spread, 1), dtype=np.float32)  # a flat patch is 0 above the line: 0 / 1
    normalised: NDArray[np.float32] = np.divide(n * pixels - total, scale, dtype=np.float32)
    return normalised.reshape(images.shape)
