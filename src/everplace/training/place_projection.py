"""Fits the projection of oriented gradients to z_p on the training places."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from everplace.adaptation.discriminant import PlaceScatter, Projection
from everplace.adaptation.oriented_gradients import OrientedGradients
from everplace.errors import ConfigError
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import inference
from everplace.model.pixels import to_input
from everplace.progress import Progress, quiet, shown
from everplace.training.config import PlaceProjection
from everplace.training.frames import SplitRoute

__all__ = ["fit_place_projection"]

STRETCH = 24
"""Places to average over, so that what still differs between traverses is weather and light rather than place."""
_STRETCHES_A_BLOCK = 5


def fit_place_projection(
    model: ConditionVAE,
    split: SplitRoute,
    config: PlaceProjection,
    progress: Progress = quiet,
    device: torch.device | None = None,
) -> None:
    """Sets `model.encoder.place_projection` to the discriminant of the training places.

    Every place is used twice, as it is and mirrored, where it is another place. Beside the differences of the
    traverses at a place, two things count as differences within places: what the traverses differ by along whole
    stretches, and what other light would change (`_OTHER_LIGHT`). Both were chosen on held-out places, for z_p to
    tell less of the condition.

    Args:
        model: A model with oriented gradients.
        split: At least two aligned traverses.
        config: What is counted, and how often.
        progress: Told of the passes over the places, and of the solving.
        device: Computes the oriented gradients; None: the processor.

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
    computed = _Gradients(gradients, device or torch.device("cpu"))
    scatter, stretches = (PlaceScatter(len(split.training), gradients.features) for _ in range(2))
    light = _LightScatter(computed)

    def passes() -> Iterator[None]:
        """Takes in all places; one item for each pass of the images of a block, so that a bar moves."""
        for start in starts:
            images = [to_input(torch.from_numpy(part.pixels[start : start + block].copy())) for part in split.training]
            for mirrored in (False, True):
                described = []
                for part in images:
                    described.append(computed(part.flip(3) if mirrored else part))
                    yield
                features = np.stack(described)
                scatter.add(features)
                stretches.add(_stretch_means(features))
                if not mirrored:
                    yield from light.add(torch.cat(images), features)

    block = STRETCH * _STRETCHES_A_BLOCK
    starts = range(0, split.places, block)
    for _ in progress(passes(), "the projection", len(starts) * (2 * len(split.training) + len(_OTHER_LIGHT))):
        pass

    def solved() -> Projection:
        nuisance = config.stretches * stretches.within() + config.light * light.scatter()
        return scatter.discriminant(dimensions, config.ridge, nuisance)

    found = shown(progress, "solving for the projection", solved)
    with torch.no_grad():
        projection.weight.copy_(torch.from_numpy(found.weight))
        projection.bias.copy_(torch.from_numpy(found.bias))


class _Gradients:
    """Oriented gradients as arrays, computed on a device."""

    def __init__(self, gradients: OrientedGradients, device: torch.device) -> None:
        self.features = gradients.features
        self._device = device
        self._layer = copy.deepcopy(gradients).to(device)

    def __call__(self, images: Tensor) -> NDArray[np.float32]:
        """(N, features) of N images."""
        with inference():
            described: NDArray[np.float32] = self._layer(images.to(self._device)).cpu().numpy()
        return described


def _stretch_means(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means over whole stretches, (T, P // STRETCH, F)."""
    traverses, places, numbers = features.shape
    whole = places // STRETCH
    cut = features[:, : whole * STRETCH].reshape(traverses, whole, STRETCH, numbers)
    means: NDArray[np.float32] = cut.mean(axis=2)
    return means


def _brighter(images: Tensor) -> Tensor:
    return images.pow(0.6)


def _overexposed(images: Tensor) -> Tensor:
    return (1.5 * images).clamp(max=1.0)


def _grainy(images: Tensor) -> Tensor:
    generator = torch.Generator().manual_seed(len(images))
    noise = torch.randn(images.shape, generator=generator)
    return (images + 0.02 * noise).clamp(0.0, 1.0)


_OTHER_LIGHT: tuple[tuple[Callable[[Tensor], Tensor], float], ...] = (
    (_brighter, 3.0),
    (_overexposed, 1.0),
    (_grainy, 1.0),
)
"""Changes of the image that other light brings, with the weights of their scatter."""


class _LightScatter:
    """How features change when the light does: half the mean outer product of the change, weighted and summed up."""

    def __init__(self, gradients: _Gradients) -> None:
        self._gradients = gradients
        self._frames = 0
        self._sum = np.zeros((gradients.features, gradients.features))

    def add(self, images: Tensor, features: NDArray[np.float32]) -> Iterator[None]:
        """Takes in images (N, C, H, W) with their features, in any shape that holds N rows; an item for each change."""
        before = features.reshape(len(images), -1).astype(np.float64)
        self._frames += len(images)
        for change, weight in _OTHER_LIGHT:
            moved = self._gradients(change(images)) - before
            self._sum += weight * moved.T @ moved
            yield

    def scatter(self) -> NDArray[np.float64]:
        """F×F."""
        return self._sum / (2 * self._frames)
