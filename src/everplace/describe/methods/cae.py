"""CAE: the code of a plain convolutional autoencoder, compared by cosine.

The predecessors of the paper's model: Oh and Lee [16] and Park [17] describe places by convolutional autoencoders. The
paper gives no more than that; `everplace.model.condition_vae.ConditionVAE` says what was decided here.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.data.images import ImageSpec
from everplace.describe.protocol import Metric, require_images
from everplace.model.checkpoint import Checkpoint, load_checkpoint
from everplace.model.images import to_input
from everplace.model.inference import default_device, inference

__all__ = ["CAEDescriber", "open_method"]


class CAEDescriber:
    """Describes with a trained autoencoder.

    Attributes:
        method: `cae`.
        image: The image size and channels that the model was trained on.
        dimension: 128.
        metric: Cosine similarity.
        checkpoint: The model and how it was made.
    """

    method: str = "cae"
    metric: Metric = "cosine"

    def __init__(self, checkpoint: Checkpoint, device: str | torch.device | None = None) -> None:
        self.checkpoint = checkpoint
        config = checkpoint.model.config
        self.image = ImageSpec((config.height, config.width), grey=config.channels == 1)
        self.dimension = config.descriptor_dimensions
        self._device = torch.device(device or default_device())
        self._model = checkpoint.model.to(self._device).eval()

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of the frames that the model was trained on or chosen by."""
        return self.checkpoint.seen_stems

    def settings(self) -> dict[str, str | int | float | bool]:
        """What tells this model from others: image, how it was trained and chosen, and the hash of its weights."""
        return self.checkpoint.settings()

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch, B×H×W×C uint8, as B×128 float32."""
        require_images(images, self.image, self.method)
        with inference():
            code = self._model.descriptor(to_input(torch.from_numpy(images).to(self._device)))
        array: NDArray[np.float32] = code.float().cpu().numpy()
        return array


def open_method(argument: str) -> CAEDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return CAEDescriber(load_checkpoint(Path(argument)))
