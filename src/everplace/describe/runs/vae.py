"""VAE, C-VAE and CP-VAE (Oh and Eoh 2021): the posterior mean of z_p (of z for the plain VAE), compared by Eq. 6."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.describe.runs.trained import TrainedDescriber, to_array
from everplace.model.checkpoint import load_checkpoint
from everplace.model.inference import inference

__all__ = ["VAEDescriber", "open_method"]


class VAEDescriber(TrainedDescriber):
    """Describes with a `vae`, `c-vae` or `cp-vae`: 128 values for the plain VAE, else the 96 of z_p."""

    def describe_with_variance(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """As `describe`, with the posterior variance of each value, B×D."""
        with inference():
            posterior = self._model.encoder(self._input(images))
            return self._block(posterior.mean), self._block(posterior.log_variance.exp())

    def _block(self, values: torch.Tensor) -> NDArray[np.float32]:
        return to_array(self._model.split.z_p(values) if self._model.config.labelled else values)


def open_method(argument: str) -> VAEDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return VAEDescriber(load_checkpoint(Path(argument)))
