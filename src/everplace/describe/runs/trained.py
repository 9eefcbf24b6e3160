"""Describing with a network that was trained into a run directory."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.describe.describer import Metric, require_images
from everplace.images.decoding import ImageSpec
from everplace.model.checkpoint import Checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import default_device, inference
from everplace.model.pixels import to_input

__all__ = ["TrainedDescriber", "to_array"]


class TrainedDescriber:
    """Describes with the model of a checkpoint, which stays as it is.

    Attributes:
        method: Kind of the model: `vae`, `c-vae`, `cp-vae` or `cae`.
        image: The image size and channels that the model was trained on.
        dimension: Numbers in a descriptor, D.
        metric: Cosine similarity, Eq. 6 of the paper.
        checkpoint: The model and how it was made.
    """

    metric: Metric = "cosine"

    def __init__(self, checkpoint: Checkpoint, device: str | torch.device | None = None) -> None:
        """Opens the model on a device.

        Args:
            checkpoint: The model.
            device: Where it is applied; None: a GPU, where there is one.
        """
        self.checkpoint = checkpoint
        config = checkpoint.model.config
        self.method: str = config.kind
        self.image = ImageSpec((config.height, config.width), grey=config.channels == 1)
        self.dimension = config.descriptor_dimensions
        self._device = torch.device(device or default_device())
        self._model = _on(checkpoint.model, self._device)

    @property
    def model(self) -> ConditionVAE:
        """The network in evaluation mode, on the device where it is applied."""
        return self._model

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of the frames that the model was trained on or chosen by."""
        return self.checkpoint.seen_stems

    def settings(self) -> dict[str, str | int | float | bool]:
        """What identifies this model: image, how it was trained and chosen, and the hash of its weights."""
        return self.checkpoint.settings()

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch, B×H×W×C uint8, as B×D float32."""
        with inference():
            return to_array(self._model.descriptor(self._input(images)))

    def _input(self, images: NDArray[np.uint8]) -> torch.Tensor:
        require_images(images, self.image, self.method)
        return to_input(torch.from_numpy(images).to(self._device))


def to_array(values: torch.Tensor) -> NDArray[np.float32]:
    """Returns values on any device as float32."""
    array: NDArray[np.float32] = values.float().cpu().numpy()
    return array


def _on(model: ConditionVAE, device: torch.device) -> ConditionVAE:
    """The model on a device; a copy where it lies on another, since `Module.to` moves it away from its owner."""
    if next(model.parameters()).device == device and not model.training:
        return model
    return deepcopy(model).to(device).eval()
