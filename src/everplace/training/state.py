"""What only resuming needs: weights, the optimizer's moments, and how far the run had come."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor

from everplace.errors import CheckpointError
from everplace.files import readable
from everplace.model.tensor_file import has_tensors, load_tensors, save_tensors

__all__ = ["RESUME", "ResumeState", "RunProgress", "load_state", "save_state"]

RESUME = "resume"
_NAME = "state"
_FORMAT = 1
_MODEL, _OPTIMIZER = "model.", "optimizer."


@dataclass(frozen=True, slots=True)
class RunProgress:
    """How far a run has come.

    Attributes:
        epoch: Complete epochs.
        seconds: Training seconds so far.
        best_epoch: The epoch that the checkpoint holds; 0 before the first.
        best_value: Its value of the criterion; None before the first.
        finished: Nothing is left to do.
    """

    epoch: int = 0
    seconds: float = 0.0
    best_epoch: int = 0
    best_value: float | None = None
    finished: bool = False


@dataclass(frozen=True)
class ResumeState:
    """A run as it stood at the end of an epoch.

    Attributes:
        progress: How far it had come.
        model: The model's state dictionary.
        optimizer: Moments and step of each parameter, by its position.
    """

    progress: RunProgress
    model: dict[str, Tensor]
    optimizer: dict[int, dict[str, Tensor]]


def save_state(
    run: Path, progress: RunProgress, model: torch.nn.Module | None, optimizer: torch.optim.Optimizer | None
) -> None:
    """Writes RUN/resume, replacing what stood there as a whole; a finished run keeps no tensors.

    Raises:
        StorageError: Writing failed; the earlier state still stands.
    """
    tensors: dict[str, Tensor] = {}
    if model is not None and optimizer is not None:
        tensors.update({f"{_MODEL}{key}": value for key, value in model.state_dict().items()})
        for index, state in optimizer.state_dict()["state"].items():
            tensors.update({f"{_OPTIMIZER}{index}.{key}": torch.as_tensor(value) for key, value in state.items()})
    save_tensors(run / RESUME, _NAME, tensors, {"format": _FORMAT, "progress": asdict(progress)})


def load_state(run: Path) -> ResumeState | None:
    """Reads RUN/resume; None if there is nothing to resume.

    Raises:
        CheckpointError: It is damaged, altered or of another version.
    """
    if not has_tensors(run / RESUME, _NAME):
        return None
    tensors, document = load_tensors(run / RESUME, _NAME, _FORMAT)
    try:
        progress = RunProgress(**document["progress"])
        model = {key.removeprefix(_MODEL): value for key, value in tensors.items() if key.startswith(_MODEL)}
        optimizer: dict[int, dict[str, Tensor]] = {}
        for key, value in tensors.items():
            if key.startswith(_OPTIMIZER):
                index, _, name = key.removeprefix(_OPTIMIZER).partition(".")
                optimizer.setdefault(int(index), {})[name] = value
    except (KeyError, TypeError, ValueError):
        raise CheckpointError(
            f"{readable(run / RESUME)} is not what this version writes; remove it to start the run anew"
        ) from None
    return ResumeState(progress, model, optimizer)
