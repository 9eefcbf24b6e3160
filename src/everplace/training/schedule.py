"""What changes over a run: the learning rate, and the weight of the KL divergence."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from itertools import groupby
from typing import Any

import torch
from torch import Tensor

from everplace.model.bounds import Weights
from everplace.model.condition_vae import ConditionVAE
from everplace.model.posterior import BLOCKS
from everplace.training.config import TrainConfig

__all__ = ["RunClock", "kl_warm_up", "learning_rate", "make_optimizer", "set_learning_rate"]

_WARMUP = 0.03  # of the whole run


class RunClock:
    """How much of a run is done, by its epochs or by its minutes."""

    def __init__(
        self, config: TrainConfig, batches: int, seconds_before: float, shared: Callable[[float], float]
    ) -> None:
        """Starts the clock: set-up does not count as training.

        Args:
            config: Says when the run ends.
            batches: Batches of an epoch.
            seconds_before: Training seconds of earlier processes of this run.
            shared: Gives every device the first one's number, so that all stop at the same step.
        """
        self._config = config
        self._batches = batches
        self._started = time.monotonic() - seconds_before
        self._shared = shared

    @property
    def seconds(self) -> float:
        """Training seconds of the whole run."""
        return time.monotonic() - self._started

    def done(self, epoch: int, batch: int) -> float:
        """How much of the run is done after `epoch` complete epochs and `batch` batches of the next, in [0, 1]."""
        if self._config.epochs is not None:
            return (epoch + batch / self._batches) / self._config.epochs
        assert self._config.minutes is not None
        return min(1.0, self._shared(self.seconds) / (60.0 * self._config.minutes))


def learning_rate(config: TrainConfig, done: float) -> float:
    """Linear warm-up, then a cosine to zero; `done` in [0, 1]."""
    warm = min(1.0, (done + 1e-3) / _WARMUP)
    return config.learning_rate * warm * 0.5 * (1.0 + math.cos(math.pi * done))


def kl_warm_up(config: TrainConfig, epochs: float) -> Weights:
    """The weights of the terms after so many epochs: those of the KL divergence rise from 0 to theirs."""
    warm = min(1.0, epochs / config.warmup_epochs) if config.warmup_epochs else 1.0
    betas = {name: getattr(config.weights, name) * warm for name in (f"beta_{block}" for block in BLOCKS)}
    return config.weights.model_copy(update=betas)


def make_optimizer(
    model: ConditionVAE, config: TrainConfig, moments: dict[int, dict[str, Tensor]] | None = None
) -> torch.optim.Optimizer:
    """AdamW over the model's parameters, in the order in which the moments of a stopped run are kept.

    Args:
        model: The network, on the device that it is trained on.
        config: Learning rates and weight decay.
        moments: Those of an earlier process of the run; None for a new one.
    """
    shares = {
        id(parameter): config.fully_connected_rate
        for chain in model.fully_connected
        for parameter in chain.parameters()
    }
    projection = model.encoder.place_projection
    if projection is not None:
        shares |= {id(parameter): config.projection.rate for parameter in projection.parameters()}
    groups: list[dict[str, Any]] = [
        {"params": list(parameters), "share": share}
        for share, parameters in groupby(model.parameters(), lambda parameter: shares.get(id(parameter), 1.0))
    ]
    optimizer = torch.optim.AdamW(groups, lr=config.learning_rate, weight_decay=config.weight_decay, fused=True)
    if moments is not None:
        optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
    return optimizer


def set_learning_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    """Gives every group of parameters its share of the rate."""
    for group in optimizer.param_groups:
        group["lr"] = rate * group["share"]
