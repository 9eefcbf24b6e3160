"""Oriented gradients in 16 directions: 2,048 numbers of any frame, made to be adapted to a route.

The fine structure that `best` starts from (`everplace.adaptation.oriented_gradients`), as a method of its own. Every
frame, of any size and shape, grey or in colour, is brought to 64×128 grey pixels first.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.adaptation.oriented_gradients import CELL, DIRECTIONS, OrientedGradients
from everplace.describe.describer import Describer, require_no_argument
from everplace.describe.files.descriptors import Settings
from everplace.images.decoding import ImageSpec
from everplace.model.inference import inference

__all__ = ["OrientedGradientsDescriber", "open_method"]

_HEIGHT, _WIDTH = 64, 128


class OrientedGradientsDescriber(Describer):
    """Describes a 64×128 grey image: 8×16 cells of 16 directions."""

    method = "hog16"
    image = ImageSpec((_HEIGHT, _WIDTH), grey=True)

    def __init__(self) -> None:
        self._gradients = OrientedGradients(_HEIGHT, _WIDTH)
        self.dimension = self._gradients.features

    def settings(self) -> Settings:
        """Returns the side of a cell in pixels and the number of directions."""
        return {"cell": CELL, "directions": DIRECTIONS}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×64×128×1 images by B×2048 values, each at least 0."""
        with inference():
            values = self._gradients(torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255)
        array: NDArray[np.float32] = values.numpy()
        return array

    def network(self) -> OrientedGradients:
        """The layer itself."""
        return self._gradients


def open_method(argument: str) -> Describer:
    """Opens it; it has no options."""
    require_no_argument("hog16", argument)
    return OrientedGradientsDescriber()
