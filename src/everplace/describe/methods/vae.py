"""VAE, C-VAE and CP-VAE (Oh and Eoh 2021): the posterior mean of z_p (of z for the plain VAE), compared by Eq. 6."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.data.images import ImageSpec
from everplace.describe.protocol import Metric, require_images
from everplace.model.checkpoint import Checkpoint, load_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.images import to_input
from everplace.model.inference import default_device, inference

__all__ = ["VAEDescriber", "open_method"]


class VAEDescriber:
    """Describes with a trained model.

    Attributes:
        method: `vae`, `c-vae` or `cp-vae`.
        image: The image size and channels that the model was trained on.
        dimension: 96, or 128 for the plain VAE.
        metric: Cosine similarity.
        checkpoint: The model and how it was made.
    """

    metric: Metric = "cosine"

    def __init__(self, checkpoint: Checkpoint, device: str | torch.device | None = None) -> None:
        self.checkpoint = checkpoint
        config = checkpoint.model.config
        self.method: str = config.kind
        self.image = ImageSpec((config.height, config.width), grey=config.channels == 1)
        self.dimension = config.descriptor_dimensions
        self._device = torch.device(device or default_device())
        self._model: ConditionVAE = checkpoint.model.to(self._device).eval()

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of the frames that the model was trained on or chosen by."""
        return self.checkpoint.seen_stems

    def settings(self) -> dict[str, str | int | float | bool]:
        """What tells this model from others: image, how it was trained and chosen, and the hash of its weights."""
        return self.checkpoint.settings()

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch, B×H×W×C uint8, as B×D float32."""
        return self.describe_with_variance(images)[0]

    def describe_with_variance(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """As `describe`, with the posterior variance of each value, B×D."""
        require_images(images, self.image, self.method)
        with inference():
            posterior = self._model.encoder(to_input(torch.from_numpy(images).to(self._device)))
            mean, variance = posterior.mean, posterior.log_variance.exp()
        return self._block(mean), self._block(variance)

    def _block(self, values: torch.Tensor) -> NDArray[np.float32]:
        block = self._model.split.z_p(values) if self._model.config.labelled else values
        array: NDArray[np.float32] = block.float().cpu().numpy()
        return array


def open_method(argument: str) -> VAEDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return VAEDescriber(load_checkpoint(Path(argument)))
