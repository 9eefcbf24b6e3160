"""CAE: the code of a plain convolutional autoencoder, compared by cosine.

The predecessors of the paper's model: Oh and Lee [16] and Park [17] describe places by convolutional autoencoders. The
paper gives no more than that; `everplace.model.condition_vae.ConditionVAE` says what was decided here.
"""

from __future__ import annotations

from pathlib import Path

from everplace.describe.runs.trained import TrainedDescriber
from everplace.model.checkpoint import load_checkpoint

__all__ = ["CAEDescriber", "open_method"]


class CAEDescriber(TrainedDescriber):
    """Describes with a `cae`, whose code has 128 values."""


def open_method(argument: str) -> CAEDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable checkpoint.
    """
    return CAEDescriber(load_checkpoint(Path(argument)))
