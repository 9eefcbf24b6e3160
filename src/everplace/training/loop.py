"""The training loop, whole: epochs, batches, step, clip, schedule, validate, keep, save."""

from __future__ import annotations

from collections.abc import Callable

import torch
from lightning_fabric import Fabric
from torch.nn.utils import clip_grad_norm_

from everplace.model.condition_vae import ConditionVAE
from everplace.training.config import TrainConfig
from everplace.training.devices import of_all_devices
from everplace.training.display import Display
from everplace.training.epoch_means import EpochMeans, require_finite
from everplace.training.frames import TrainingFrames
from everplace.training.run_keeper import RunKeeper
from everplace.training.schedule import RunClock, kl_warm_up, learning_rate, set_learning_rate
from everplace.training.step import BoundStep

__all__ = ["GRADIENT_NORM", "run_epochs"]

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
    """Trains a model for the epochs that remain after `keeper.progress`.

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
    step, fabric_optimizer = fabric.setup(bound, optimizer)
    clock = RunClock(config, len(frames), keeper.progress.seconds, shared=fabric.broadcast)
    model.train()
    epoch, stopped = keeper.progress.epoch, False
    while not stopped:
        means, has_checkpoint = EpochMeans(), keeper.progress.best_epoch > 0
        display.begin_epoch(epoch, len(frames))
        for index, batch in enumerate(frames.batches(epoch, fabric.global_rank, fabric.world_size, fabric.device)):
            done = clock.done(epoch, index)  # of the run, in [0, 1]
            set_learning_rate(optimizer, learning_rate(config, done))
            weights = kl_warm_up(config, epoch + (index + 1) / len(frames))
            loss, measured, z_p = step(batch, epoch * len(frames) + index, weights)  # scalar, means, (B, P)
            if not torch.isfinite(loss):
                require_finite({**measured, "loss": loss}, epoch + 1, has_checkpoint=has_checkpoint)
            fabric_optimizer.zero_grad()
            fabric.backward(loss)
            clip_grad_norm_(model.parameters(), GRADIENT_NORM)
            fabric_optimizer.step()
            if model.place_head is not None:
                model.place_head.follow(*of_all_devices(fabric, z_p, batch.places))
            means.add(measured)
            display.advance()
            if done >= 1.0:
                break
        epoch += 1
        stopped = done >= 1.0 or epoch == config.epochs
        # No later loss tells what the epoch's last step did to the weights.
        require_finite(model.state_dict(), epoch, has_checkpoint=has_checkpoint)
        model.log_sigma.copy_(means.log_sigma(fabric))  # fixed: a bound is only ever evaluated with it
        row = {"epoch": float(epoch), "seconds": clock.seconds, **means.row(fabric, model.split)}
        row |= {"sigma": float(model.log_sigma.exp()), "learning_rate": float(optimizer.param_groups[0]["lr"])}
        if epoch % config.validate_every == 0 or stopped:
            row |= (held_out := validate(model))
            require_finite(held_out, epoch, has_checkpoint=has_checkpoint)
        if fabric.is_global_zero:
            keeper.keep(model, optimizer, row, last=stopped)
        keeper.progress = fabric.broadcast(keeper.progress)
        display.end_epoch(row)
