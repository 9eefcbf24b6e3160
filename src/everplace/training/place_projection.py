"""Fits the projection of oriented gradients to z_p on the training places."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.errors import ConfigError
from everplace.model.architecture import ConditionVAE
from everplace.model.discriminant import PlaceScatter
from everplace.model.images import to_input
from everplace.model.oriented_gradients import OrientedGradients
from everplace.progress import Progress, quiet
from everplace.training.frames import SplitRoute

__all__ = ["fit_place_projection"]

_PLACES_A_BLOCK = 128


def fit_place_projection(model: ConditionVAE, split: SplitRoute, ridge: float, progress: Progress = quiet) -> None:
    """Sets `model.encoder.place_projection` to the discriminant of the training places.

    Every place is taken in as it is and in a mirror, where it is another place.

    Args:
        model: A model with oriented gradients.
        split: At least two aligned traverses.
        ridge: Of `PlaceScatter.discriminant`.
        progress: Told of the blocks of places.

    Raises:
        ConfigError: z_p is larger than the oriented gradients of an image.
    """
    gradients, projection = model.encoder.gradients, model.encoder.place_projection
    assert gradients is not None
    assert projection is not None
    dimensions = projection.out_features
    if dimensions > gradients.features:
        raise ConfigError(
            f"images of this size have {gradients.features} oriented gradients, too few for a z_p of {dimensions}; "
            "give a larger image_size or set oriented_gradients to false"
        )
    scatter = PlaceScatter(len(split.training), gradients.features)
    starts = range(0, split.places, _PLACES_A_BLOCK)
    for start in progress(starts, "places for the projection", len(starts)):
        pixels = [block.pixels[start : start + _PLACES_A_BLOCK] for block in split.training]
        for direction in (1, -1):
            scatter.add(np.stack([_features(gradients, part[:, :, ::direction]) for part in pixels]))
    found = scatter.discriminant(dimensions, ridge)
    with torch.no_grad():
        projection.weight.copy_(torch.from_numpy(found.weight))
        projection.bias.copy_(torch.from_numpy(found.bias))


def _features(gradients: OrientedGradients, pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    described: NDArray[np.float32] = gradients(to_input(torch.from_numpy(pixels.copy()))).numpy()
    return described
