"""Describing with a network that was trained into a run directory, compared by Eq. 6 of the paper, the cosine.

VAE, C-VAE and CP-VAE (Oh and Eoh 2021): the posterior mean of z_p, 96 values, or of all of z for the plain VAE, 128.
CAE: the code of a plain convolutional autoencoder, 128 values; the predecessors of the paper's model, Oh and Lee [16]
and Park [17], describe places by these. The paper gives no more than that;
`everplace.model.condition_vae.ConditionVAE` says what was decided here.
"""

from __future__ import annotations

from contextlib import nullcontext
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.images.decoding import ImageSpec
from everplace.model.checkpoint import Checkpoint, load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import default_device, inference
from everplace.model.pixels import to_input
from everplace.threads import one_torch_thread

__all__ = ["TrainedDescriber", "open_method"]

NOTES = (
    ("RUN of cp-vae", "a run directory of the paper's model, or of the recipe best", "everplace train", 96),
    ("RUN of c-vae", "the paper's model without places", "everplace train", 96),
    ("RUN of vae", "a plain variational autoencoder", "everplace train", 128),
    ("RUN of cae", "a plain convolutional autoencoder", "everplace train", 128),
)


class _PlaceEncoder(nn.Module):
    """Images in [0, 1], (B, C, H, W), to the place descriptor, (B, D)."""

    def __init__(self, model: ConditionVAE) -> None:
        super().__init__()
        self.model = model

    def forward(self, images: Tensor) -> Tensor:
        return self.model.descriptor(images)


class TrainedDescriber(Describer):
    """Describes with the model of a checkpoint, which stays as it is."""

    checkpoint: Checkpoint

    def __init__(self, checkpoint: Checkpoint, device: str | torch.device | None = None) -> None:
        """Opens the model on a device.

        Args:
            checkpoint: The model.
            device: Where it is applied; None: a GPU, where there is one.
        """
        config = checkpoint.model.config
        self.method = config.kind
        self.image = ImageSpec((config.height, config.width), grey=config.channels == 1)
        self.dimension = config.descriptor_dimensions
        self.seen_stems = checkpoint.seen_stems
        self.seen_images = checkpoint.seen_images
        self.checkpoint = checkpoint
        self._device = torch.device(device or default_device())
        self._model = _on(checkpoint.model, self._device)
        self.latent_model = None if config.kind == "cae" else self._model

    def settings(self) -> Settings:
        """What identifies this model: image, how it was trained and chosen, and the hash of its weights."""
        return self.checkpoint.settings()

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch, B×H×W×C uint8, as B×D float32."""
        # A frame's oriented gradients are projected in less time than threads take to find each other.
        small = len(images) == 1 and self._model.encoder.place_projection is not None
        with inference(), one_torch_thread() if small else nullcontext():
            values = self._model.descriptor(to_input(torch.from_numpy(images).to(self._device)))
        array: NDArray[np.float32] = values.float().cpu().numpy()
        return array

    def network(self) -> nn.Module:
        """The encoder, as far as the descriptor needs it."""
        return _PlaceEncoder(_on(self._model, torch.device("cpu")))


def open_method(argument: str) -> TrainedDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return TrainedDescriber(load_checkpoint(Path(argument)))


def _on(model: ConditionVAE, device: torch.device) -> ConditionVAE:
    """The model on a device; a copy where it lies on another, since `Module.to` moves it away from its owner."""
    if next(model.parameters()).device == device and not model.training:
        return model
    return deepcopy(model).to(device).eval()
