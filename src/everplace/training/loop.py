"""The training loop, whole: epochs, batches, step, clip, schedule, validate, keep, save."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.nn.utils import clip_grad_norm_

from everplace.errors import DivergedError
from everplace.images.decoding import map_ahead
from everplace.model.bounds import soft_clipped_log_sigma
from everplace.model.condition_vae import ConditionVAE
from everplace.model.place_head import PlaceHead
from everplace.model.posterior import ACTIVE_ABOVE
from everplace.training.config import TrainConfig
from everplace.training.display import Display
from everplace.training.frames import Batch, TrainingFrames
from everplace.training.run_keeper import RunKeeper
from everplace.training.schedule import RunClock, kl_warm_up, learning_rate, set_learning_rate
from everplace.training.step import BoundStep

__all__ = ["GRADIENT_NORM", "batches", "run_epochs"]

GRADIENT_NORM = 5.0


def run_epochs(
    fabric: Fabric,
    model: ConditionVAE,
    optimizer: torch.optim.Optimizer,
    frames: TrainingFrames,
    validate: Callable[[ConditionVAE], dict[str, float]],
    config: TrainConfig,
    keeper: RunKeeper,
    display: Display,
) -> None:
    """Trains a model from where the keeper's run stands to its end.

    Everything random is a function of (seed, epoch, step), so a run that was killed and resumed repeats what was lost.

    Args:
        fabric: Devices and precision; launched.
        model: On the device of `fabric`, as the run stands.
        optimizer: Of `make_optimizer`, of this model.
        frames: The training frames.
        validate: Measures the model on the held-out frames.
        config: The run's configuration.
        keeper: Keeps the best epoch, the metrics, and what resuming needs.
        display: Shows the training.

    Raises:
        DivergedError: Training met a number that is not finite.
        StorageError: The run directory cannot be written to.
    """
    bound = BoundStep(model, config.seed, config.place_spread, fabric.global_rank, fabric.world_size)
    step, stepper = fabric.setup(bound, optimizer)
    clock = RunClock(config, len(frames), keeper.progress.seconds, shared=fabric.broadcast)
    model.train()
    epoch, stopped = keeper.progress.epoch, False
    while not stopped:
        sums: dict[str, Tensor] = {}
        display.begin_epoch(epoch, len(frames))
        for index, batch in enumerate(batches(fabric, frames, epoch)):
            done = clock.done(epoch, index)
            set_learning_rate(optimizer, learning_rate(config, done))
            weights = kl_warm_up(config, epoch + (index + 1) / len(frames))
            loss, means, z_p = step(batch, epoch * len(frames) + index, weights)
            if not torch.isfinite(loss):
                _require_finite({**means, "loss": loss}, epoch, keeper)
            _follow_places(fabric, model, z_p, batch.places)
            stepper.zero_grad()
            fabric.backward(loss)
            clip_grad_norm_(model.parameters(), GRADIENT_NORM)
            stepper.step()
            sums = {name: sums.get(name, 0.0) + mean for name, mean in means.items()}
            display.advance()
            if done >= 1.0:
                break
        epoch += 1
        stopped = done >= 1.0 or epoch == config.epochs
        # No later loss would tell of what the epoch's last step did.
        _require_finite(model.state_dict(), epoch - 1, keeper)
        row = {"epoch": float(epoch), "seconds": clock.seconds, **_epoch_means(fabric, model, sums, index + 1)}
        row["learning_rate"] = float(optimizer.param_groups[0]["lr"])
        if epoch % config.validate_every == 0 or stopped:
            measured = validate(model)
            _require_finite(measured, epoch - 1, keeper)
            row |= measured
        if fabric.is_global_zero:
            keeper.keep(model, optimizer, row, last=stopped)
        keeper.progress = fabric.broadcast(keeper.progress)
        display.end_epoch(row)


def batches(fabric: Fabric, frames: TrainingFrames, epoch: int) -> Iterator[Batch]:
    """This device's part of the batches of an epoch, on the device.

    On the CPU the network uses all cores itself. A CUDA device leaves the processor free: threads augment batches
    ahead, in memory that the device reads from without waiting. (OpenCV lets go of the interpreter's lock; worker
    processes would be forked from a process that holds threads, which may hang, or import torch anew.)
    """
    order = frames.order(epoch, fabric.global_rank, fabric.world_size)
    if fabric.device.type != "cuda":
        yield from (frames.batch(epoch, positions) for positions in order)
        return
    pinned = map_ahead(lambda positions: Batch(*(part.pin_memory() for part in frames.batch(epoch, positions))), order)
    for batch in pinned:
        yield Batch(*(part.to(fabric.device, non_blocking=True) for part in batch))


def _follow_places(fabric: Fabric, model: ConditionVAE, z_p: Tensor, places: Tensor) -> None:
    """Moves the place vectors; with several devices by the frames of all, so that the vectors stay the same."""
    if not isinstance(model.place_head, PlaceHead):
        return
    if fabric.world_size > 1:
        gathered: Any = fabric.all_gather((z_p, places))
        z_p, places = (part.flatten(0, 1) for part in gathered)
    model.place_head.follow(z_p, places)


def _epoch_means(fabric: Fabric, model: ConditionVAE, sums: dict[str, Tensor], steps: int) -> dict[str, float]:
    """Means of the terms over an epoch and over all devices, sigma, and active dimensions.

    The sigma that training reached is fixed in the model from here on: a bound is only ever evaluated with it.
    """
    means = {name: _mean_over_devices(fabric, total) / steps for name, total in sums.items()}
    kl, square = means.pop("kl_dimensions", None), means.pop("square")
    row = {name: float(mean) for name, mean in means.items()}
    if kl is not None:
        active = model.split.blocks(kl > ACTIVE_ABOVE)
        row |= {f"active_{block}": float(dimensions.sum()) for block, dimensions in active.items()}
    model.log_sigma.copy_(soft_clipped_log_sigma(square))
    return {**row, "sigma": float(model.log_sigma.exp())}


def _mean_over_devices(fabric: Fabric, value: Tensor) -> Tensor:
    mean: Any = fabric.all_reduce(value.clone(), reduce_op="mean")
    return torch.as_tensor(mean)


def _require_finite(values: Mapping[str, Tensor | float], epoch: int, keeper: RunKeeper) -> None:
    """Stops a run whose weights, terms or measurements are not numbers any more.

    Raises:
        DivergedError: One of the values is not finite.
    """
    wrong = [name for name, value in values.items() if not torch.isfinite(torch.as_tensor(value)).all()]
    if wrong:
        kept = "the last good checkpoint stands; " if keeper.progress.best_epoch > 0 else ""
        raise DivergedError(
            f"training diverged in epoch {epoch + 1}: {wrong[0]} is not finite; {kept}"
            "try a lower learning_rate or smaller weights"
        )
