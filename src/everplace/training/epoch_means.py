"""What an epoch of steps comes to: means of the terms, and whether all of it is finite."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor

from everplace.errors import DivergedError
from everplace.model.bounds import soft_clipped_log_sigma
from everplace.model.posterior import ACTIVE_ABOVE, LatentSplit

__all__ = ["EpochMeans", "require_finite"]


class EpochMeans:
    """Sums up what the steps of an epoch measure."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._steps = 0

    def add(self, means: Mapping[str, Tensor]) -> None:
        """Takes in the means over a step's frames, as `BoundStep` gives them."""
        self._sums = {name: self._sums.get(name, 0.0) + mean for name, mean in means.items()}
        self._steps += 1

    def row(self, fabric: Fabric, split: LatentSplit) -> dict[str, float]:
        """Means of the terms over the epoch and over all devices, and the active dimensions of each block."""
        row = {name: float(self._mean(fabric, name)) for name in self._sums if name not in ("square", "kl_dimensions")}
        if "kl_dimensions" in self._sums:
            active = split.blocks(self._mean(fabric, "kl_dimensions") > ACTIVE_ABOVE)
            row |= {f"active_{block}": float(dimensions.sum()) for block, dimensions in active.items()}
        return row

    def log_sigma(self, fabric: Fabric) -> Tensor:
        """The log sigma that the epoch's squared error asks for, a scalar."""
        return soft_clipped_log_sigma(self._mean(fabric, "square"))

    def _mean(self, fabric: Fabric, name: str) -> Tensor:
        over_devices: Any = fabric.all_reduce(self._sums[name].clone(), reduce_op="mean")
        return torch.as_tensor(over_devices) / self._steps


def require_finite(values: Mapping[str, Tensor | float], epoch: int, *, has_checkpoint: bool) -> None:
    """Stops a run whose weights, terms or measurements are not numbers any more.

    Args:
        values: By name.
        epoch: Number of the epoch, from 1.
        has_checkpoint: Whether the run directory holds a checkpoint of this run.

    Raises:
        DivergedError: One of the values is not finite.
    """
    wrong = [name for name, value in values.items() if not torch.isfinite(torch.as_tensor(value)).all()]
    if wrong:
        kept = "the last good checkpoint stands; " if has_checkpoint else ""
        raise DivergedError(
            f"training diverged in epoch {epoch}: {wrong[0]} is not finite; {kept}"
            "try a lower learning_rate or smaller weights"
        )
