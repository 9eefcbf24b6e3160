"""A trained model on disk: its configuration and how it was chosen as JSON, its weights as safetensors."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from pydantic import ValidationError
from torch import Tensor

from everplace.adaptation.oriented_gradients import gradient_features
from everplace.errors import CheckpointError
from everplace.files import readable
from everplace.model.architecture import flattened_size
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.provenance import images_seen, plain_values, stems_seen
from everplace.settings import first_problem
from everplace.tensor_file import load_tensors, save_tensors

__all__ = ["CHECKPOINT_NAME", "Checkpoint", "load_checkpoint", "save_checkpoint"]

CHECKPOINT_NAME = "checkpoint"
_FORMAT = 1


@dataclass(frozen=True)
class Checkpoint:
    """A model with what is known of its making.

    Attributes:
        model: The network, with its weights, in evaluation mode and on the CPU.
        about: How it was trained and chosen: recipe, seed, epoch, criterion and its value, fingerprint of the images
            and their stems.
        sha256: Of the file of the weights, in hex; empty for a model that was not loaded from a file.
    """

    model: ConditionVAE
    about: dict[str, Any] = field(default_factory=dict)
    sha256: str = ""

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of all frames that were trained on or chose the epoch; empty where that was not recorded."""
        return stems_seen(self.about)

    @property
    def seen_images(self) -> frozenset[str]:
        """The images of these places, told by their content; empty where that was not recorded."""
        return images_seen(self.about)

    def settings(self) -> dict[str, str | int | float | bool]:
        """What identifies this model: image, how it was trained and chosen, and the hash of its weights."""
        config = self.model.config
        return {
            "height": config.height,
            "width": config.width,
            "channels": config.channels,
            **plain_values(self.about),
            "weights": self.sha256[:16],
        }


def save_checkpoint(run: Path, model: ConditionVAE, about: dict[str, Any]) -> None:
    """Writes the model into a run directory, replacing an earlier checkpoint as a whole.

    Raises:
        StorageError: Writing failed; an earlier checkpoint still stands.
    """
    document = {"format": _FORMAT, "model": model.config.model_dump(mode="json"), "about": about}
    save_tensors(run, CHECKPOINT_NAME, model.state_dict(), document)


def load_checkpoint(run: str | Path) -> Checkpoint:
    """Reads the model of a run directory.

    Raises:
        CheckpointError: There is none, or it is of another version, malformed or altered.
    """
    run = Path(run)
    if not run.is_dir():
        raise CheckpointError(f"{readable(run)} is not a run directory; give one that everplace train wrote")
    tensors, document = load_tensors(run, CHECKPOINT_NAME, _FORMAT)
    try:
        config = ModelConfig.model_validate(document.get("model"))
    except ValidationError as error:
        problem = first_problem(error, ModelConfig)
        raise CheckpointError(
            f"{readable(run / CHECKPOINT_NAME)}.json describes no model: {problem.setting or 'model'}: "
            f"{problem.reason}; train again"
        ) from None
    about = document.get("about")
    model = _model(run, config, tensors).eval()
    return Checkpoint(model, about if isinstance(about, dict) else {}, document["tensors"]["sha256"])


def _model(run: Path, config: ModelConfig, tensors: dict[str, Tensor]) -> ConditionVAE:
    """The network with these weights, which must be all that it has and nothing else."""
    # torch counts in 64 bits and says so in one of these two.
    with contextlib.suppress(RuntimeError, TypeError):
        if _may_be_of_size(config, tensors):
            # Without memory of its own the network takes the tensors as they are: no random numbers are drawn for
            # nothing, and a file that describes a network larger than the machine is refused like any other.
            with torch.device("meta"):
                model = ConditionVAE(config)
            wanted = {key: (value.shape, value.dtype) for key, value in model.state_dict().items()}
            if wanted == {key: (value.shape, value.dtype) for key, value in tensors.items()}:
                model.load_state_dict(tensors, assign=True)
                return model
    raise CheckpointError(
        f"the weights in {readable(run)} do not fit the model that checkpoint.json describes; train again"
    )


def _may_be_of_size(config: ModelConfig, tensors: dict[str, Tensor]) -> bool:
    """Whether the projection of oriented gradients has the image's size.

    Their matrices, which no file holds, would else be made in numpy for an image of any size.
    """
    projection = tensors.get("encoder.place_projection.weight")
    reading = tensors.get("encoder.fully_connected.0.0.weight", tensors.get("encoder.z_mean.weight"))
    if not config.oriented_gradients:
        return True
    return (
        projection is not None
        and reading is not None
        and projection.shape[-1:] == (gradient_features(config.height, config.width),)
        and reading.shape[-1:] == (flattened_size(config.height, config.width),)
    )
