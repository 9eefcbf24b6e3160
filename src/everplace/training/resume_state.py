"""What only resuming needs: weights, the optimizer's moments, and how far the run had come."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from torch import Tensor

from everplace.errors import CheckpointError
from everplace.files import readable
from everplace.tensor_file import has_tensors, load_tensors, save_tensors

__all__ = ["RESUME", "ResumeState", "RunProgress", "has_state", "load_state", "require_fitting", "save_state"]

RESUME = "resume"
_NAME = "state"
_FORMAT = 1
_MODEL, _OPTIMIZER = "model.", "optimizer."

_Count = Annotated[int, Field(ge=0)]


class RunProgress(BaseModel):
    """How far a run has come.

    Attributes:
        epoch: Complete epochs.
        seconds: Training seconds so far.
        best_epoch: The epoch that the checkpoint holds; 0 before the first.
        best_value: Its value of the criterion; None before the first.
        finished: Nothing is left to do.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    epoch: _Count = 0
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    best_epoch: _Count = 0
    best_value: Annotated[float, Field(allow_inf_nan=False)] | None = None
    finished: bool = False


class _Document(BaseModel):
    """What state.json says beside what `tensor_file` reads."""

    model_config = ConfigDict(strict=True)

    progress: RunProgress
    images: str = ""


@dataclass(frozen=True)
class ResumeState:
    """A run as it stood at the end of an epoch.

    Attributes:
        progress: How far it had come.
        model: The model's state dictionary.
        optimizer: Moments and step of each parameter, by its position.
        images: Fingerprint of the images that it is trained on; empty if that is not known.
    """

    progress: RunProgress
    model: dict[str, Tensor]
    optimizer: dict[int, dict[str, Tensor]]
    images: str = ""


def save_state(
    run: Path,
    progress: RunProgress,
    model: torch.nn.Module | None,
    optimizer: torch.optim.Optimizer | None,
    images: str = "",
) -> None:
    """Writes RUN/resume, replacing what stood there as a whole; a finished run keeps no tensors.

    Args:
        run: The run directory.
        progress: How far the run has come.
        model: The network; None for a finished run, as is all that follows.
        optimizer: Of the network's parameters.
        images: Fingerprint of the images.

    Raises:
        StorageError: Writing failed; the earlier state still stands.
    """
    tensors: dict[str, Tensor] = {}
    if model is not None and optimizer is not None:
        tensors.update({f"{_MODEL}{key}": value for key, value in model.state_dict().items()})
        for index, state in optimizer.state_dict()["state"].items():
            tensors.update({f"{_OPTIMIZER}{index}.{key}": torch.as_tensor(value) for key, value in state.items()})
    save_tensors(run / RESUME, _NAME, tensors, {"format": _FORMAT, "progress": progress.model_dump(), "images": images})


def has_state(run: Path) -> bool:
    """Whether there is something to resume in a run directory."""
    return has_tensors(run / RESUME, _NAME)


def load_state(run: Path) -> ResumeState | None:
    """Reads RUN/resume; None if there is nothing to resume.

    Raises:
        CheckpointError: It is damaged, altered or of another version.
    """
    if not has_tensors(run / RESUME, _NAME):
        return None
    tensors, document = load_tensors(run / RESUME, _NAME, _FORMAT)
    try:
        known = _Document.model_validate(document)
        model = {key.removeprefix(_MODEL): value for key, value in tensors.items() if key.startswith(_MODEL)}
        optimizer: dict[int, dict[str, Tensor]] = {}
        for key, value in tensors.items():
            if key.startswith(_OPTIMIZER):
                index, _, name = key.removeprefix(_OPTIMIZER).partition(".")
                optimizer.setdefault(int(index), {})[name] = value
    except (ValidationError, ValueError):
        raise CheckpointError(
            f"{readable(run / RESUME)} is not what this version writes; remove it to start the run anew"
        ) from None
    return ResumeState(known.progress, model, optimizer, known.images)


def require_fitting(state: ResumeState, model: torch.nn.Module) -> None:
    """Makes sure that a state's tensors are those of a model and of its optimizer.

    Raises:
        CheckpointError: A tensor is missing, is unknown, or has another shape.
    """
    moments = [
        {"step": torch.Size(), "exp_avg": parameter.shape, "exp_avg_sq": parameter.shape}
        for parameter in model.parameters()
    ]
    fits = _shapes(model.state_dict()) == _shapes(state.model) and all(
        index in range(len(moments)) and moments[index] == _shapes(of_one) for index, of_one in state.optimizer.items()
    )
    if not fits:
        raise CheckpointError(
            f"the tensors in {RESUME} do not fit the model that config.toml and the route make; restore what was "
            "changed, or train anew into another directory"
        )


def _shapes(tensors: dict[str, Tensor]) -> dict[str, torch.Size]:
    return {key: value.shape for key, value in tensors.items()}
