"""A method with very many numbers, brought to fewer by a fixed random map, so that it can be adapted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.pretrained.gaussian_projection import gaussian_matrix

__all__ = ["MOST_FEATURES", "ReducedDescriber", "reduced", "unreduced"]

MOST_FEATURES = 4096
"""Numbers up to which covariances are kept: F×F of them take 134 MB."""
_SEED = 0


class ReducedDescriber(Describer):
    """Describes with a method and a Gaussian random projection of its numbers to 4,096.

    The map is the same everywhere, so that sums over features of different drives and machines still add up.

    Attributes:
        base: The method.
        matrix: (4096, F).
    """

    def __init__(self, base: Describer) -> None:
        """Draws the map for the method's number of features."""
        self.base = base
        self.method = base.method
        self.image = base.image
        self.batch = base.batch
        self.dimension = MOST_FEATURES
        self.seen_stems, self.seen_images = base.seen_stems, base.seen_images
        self.matrix = gaussian_matrix(base.dimension, MOST_FEATURES, _SEED) * np.float32(MOST_FEATURES**-0.5)

    def settings(self) -> Settings:
        """Returns those of the method, and the map's."""
        return {**self.base.settings(), "reduced_to": MOST_FEATURES, "reduction_seed": _SEED}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×C images by B×4096 numbers."""
        return self.base.describe_batch(images) @ self.matrix.T


def reduced(describer: Describer) -> Describer:
    """The method itself, or where it has more than 4,096 numbers, the method and the map."""
    return ReducedDescriber(describer) if describer.dimension > MOST_FEATURES else describer


def unreduced(describer: Describer, projection: Projection) -> tuple[Describer, Projection]:
    """One map instead of two: the method without its reduction, and the projection of all its numbers.

    Args:
        describer: Of `reduced`.
        projection: Of its numbers.
    """
    if not isinstance(describer, ReducedDescriber):
        return describer, projection
    return describer.base, Projection(projection.weight @ describer.matrix, projection.bias)
