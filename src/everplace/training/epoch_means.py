"""What an epoch of steps comes to: means of the terms, and whether all of it is finite."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor

from everplace.errors import DivergedError
from everplace.model.bounds import soft_clipped_log_sigma
from everplace.model.condition_vae import ConditionVAE
from everplace.model.posterior import ACTIVE_ABOVE

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

    def row(self, fabric: Fabric, model: ConditionVAE) -> dict[str, float]:
        """Means of the terms over the epoch and over all devices, sigma, and active dimensions.

        The sigma that training reached is fixed in the model from here on: a bound is only ever evaluated with it.
        """
        means = {name: self._mean(fabric, total) for name, total in self._sums.items()}
        kl, square = means.pop("kl_dimensions", None), means.pop("square")
        row = {name: float(mean) for name, mean in means.items()}
        if kl is not None:
            active = model.split.blocks(kl > ACTIVE_ABOVE)
            row |= {f"active_{block}": float(dimensions.sum()) for block, dimensions in active.items()}
        model.log_sigma.copy_(soft_clipped_log_sigma(square))
        return {**row, "sigma": float(model.log_sigma.exp())}

    def _mean(self, fabric: Fabric, total: Tensor) -> Tensor:
        over_devices: Any = fabric.all_reduce(total.clone(), reduce_op="mean")
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
