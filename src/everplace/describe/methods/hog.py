"""HOG: one histogram of oriented gradients over the whole image.

Dalal and Triggs, "Histograms of Oriented Gradients for Human Detection", CVPR 2005, as OpenCV computes it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer, require_no_argument
from everplace.describe.files.descriptors import Settings
from everplace.images.decoding import ImageSpec

__all__ = ["HOG", "open_method"]

NOTES = (("hog", "histograms of oriented gradients; the strongest without training", "", 3780),)

_WINDOW = (128, 64)  # width, height, as all sizes here: OpenCV's order
_BLOCK = (16, 16)
_STRIDE = (8, 8)
_CELL = (8, 8)
_BINS = 9


class HOG(Describer):
    """Describes a 128×64 (width × height) grey image: 15×7 blocks of 2×2 cells of 9 unsigned orientations."""

    method = "hog"
    image = ImageSpec(size=(64, 128), grey=True)
    dimension = 3780

    def __init__(self) -> None:
        self._hog = cv2.HOGDescriptor(_WINDOW, _BLOCK, _STRIDE, _CELL, _BINS)

    def settings(self) -> Settings:
        """Returns the sides of the cells and blocks in pixels and the number of orientation bins."""
        return {"cell": _CELL[0], "block": _BLOCK[0], "bins": _BINS}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×64×128×1 images by B×3780 values in [0, 1]; a block of 36 is of length 1, or 0."""
        return np.stack([np.asarray(self._hog.compute(image), np.float32).reshape(-1) for image in images])


def open_method(argument: str) -> Describer:
    """Opens HOG, which has no options."""
    require_no_argument("hog", argument)
    return HOG()
