"""The Lightning module: one step of the weighted bound, everything random drawn from (seed, step)."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Mapping
from itertools import groupby
from typing import Any

import lightning
import torch
from torch import Tensor

from everplace.errors import DivergedError
from everplace.model.bounds import Weights, optimal_log_sigma, soft_clipped_log_sigma, soft_place_targets
from everplace.model.condition_vae import ConditionVAE, Output
from everplace.model.pixels import to_input
from everplace.model.place_head import PlaceHead
from everplace.model.posterior import ACTIVE_ABOVE
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch
from everplace.training.remedies import RemedyTerms
from everplace.training.terms import bound_terms, step_noise

__all__ = ["BoundModule"]

_WARMUP = 0.03  # of the whole run


class BoundModule(lightning.LightningModule):
    """Maximises the weighted bound of a model.

    Attributes:
        model: The network.
        remedies: What the run adds to the bound.
        config: The run's configuration.
        first_epoch: Epochs that were done before this process started.
        seconds_before: Training seconds of earlier processes of this run.
        has_checkpoint: Whether the run directory holds a checkpoint of this run.
    """

    def __init__(
        self,
        model: ConditionVAE,
        remedies: RemedyTerms,
        config: TrainConfig,
        steps_per_epoch: int,
        *,
        first_epoch: int = 0,
        seconds_before: float = 0.0,
        has_checkpoint: bool = False,
        optimizer_state: dict[int, dict[str, Tensor]] | None = None,
    ) -> None:
        super().__init__()
        self.model = model
        self.remedies = remedies
        self.config = config
        self.first_epoch = first_epoch
        self.seconds_before = seconds_before
        self.has_checkpoint = has_checkpoint
        self._steps_per_epoch = steps_per_epoch
        self._optimizer_state = optimizer_state
        self._started = time.monotonic()
        self._sums: dict[str, Tensor] = defaultdict(lambda: torch.zeros((), device=self.device))
        self._steps = 0

    @property
    def epoch(self) -> int:
        """Epochs of the whole run that are complete."""
        return self.first_epoch + self.current_epoch

    @property
    def seconds(self) -> float:
        """Training seconds of the whole run."""
        return self.seconds_before + time.monotonic() - self._started

    def on_train_start(self) -> None:
        """Starts the clock: set-up does not count as training."""
        self._started = time.monotonic()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """AdamW, with the moments of an earlier process if the run is resumed."""
        shares = self._rates()
        # In the model's order, by which the moments of a stopped run are kept.
        groups: list[dict[str, Any]] = [
            {"params": list(parameters), "share": share}
            for share, parameters in groupby(self.parameters(), lambda parameter: shares.get(id(parameter), 1.0))
        ]
        optimizer = torch.optim.AdamW(
            groups, lr=self.config.learning_rate, weight_decay=self.config.weight_decay, fused=True
        )
        if self._optimizer_state is not None:
            groups = optimizer.state_dict()["param_groups"]
            optimizer.load_state_dict({"state": self._optimizer_state, "param_groups": groups})
            self._optimizer_state = None
        return optimizer

    def _rates(self) -> dict[int, float]:
        """The learning rate of the parameters that have one of their own, as a fraction of the others'."""
        shares = {
            id(parameter): self.config.fully_connected_rate
            for chain in self.model.fully_connected
            for parameter in chain.parameters()
        }
        projection = self.model.encoder.place_projection
        if projection is not None:
            shares |= {id(parameter): self.config.projection.rate for parameter in projection.parameters()}
        return shares

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Limits the norm of the gradient.

        Lightning's own clipping refuses a fused optimizer in mixed precision, for fear of gradients that are still
        scaled; bfloat16 needs no scaling.
        """
        if gradient_clip_val:
            torch.nn.utils.clip_grad_norm_(self.parameters(), gradient_clip_val)

    def progress(self, batch_index: int) -> float:
        """How much of the run is done, in [0, 1]: of its epochs, or of its minutes."""
        if self.config.epochs is not None:
            return (self.epoch + batch_index / self._steps_per_epoch) / self.config.epochs
        assert self.config.minutes is not None
        return min(1.0, self._shared_seconds() / (60.0 * self.config.minutes))

    def on_train_batch_start(self, batch: Batch, batch_idx: int) -> None:
        """Sets the learning rate: linear warm-up, then a cosine to zero; stops a run by the clock."""
        progress = self.progress(batch_idx)
        warm = min(1.0, (progress + 1e-3) / _WARMUP)
        rate = self.config.learning_rate * warm * 0.5 * (1.0 + math.cos(math.pi * progress))
        for group in self.trainer.optimizers[0].param_groups:
            group["lr"] = rate * group["share"]
        if self.config.minutes is not None and progress >= 1.0:
            self.trainer.should_stop = True

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """The negative objective: a mean over frames, divided by the number of pixel values.

        Raises:
            DivergedError: The loss is not finite.
        """
        step = self._step(batch_idx)
        images = to_input(batch.images)
        world, rank = self.trainer.world_size, self.trainer.global_rank
        noise = step_noise(self.config.seed, step, len(images) * world, self.model.config.latent_dimensions)
        output = self.model(images, noise[rank::world].to(self.device))
        log_sigma = optimal_log_sigma(images, output.reconstruction)
        weights = self._weights(batch_idx)
        targets = (batch.conditions, self._place_target(batch))
        terms = bound_terms(self.model, images, output, log_sigma, targets, weights)
        labels = (batch.conditions, batch.places)
        terms |= self.remedies(self.model, images, output, log_sigma, labels, self.progress(batch_idx))
        loss = -self.remedies.objective(terms, weights) / images[0].numel()
        if not torch.isfinite(loss):
            self.require_finite({**terms, "loss": loss})
        self._remember(terms, images, output, batch.conditions)
        self._follow_places(output, batch.places)
        return loss

    def require_finite(self, values: Mapping[str, Tensor | float]) -> None:
        """Stops a run whose weights, terms or measurements are not numbers any more.

        Raises:
            DivergedError: One of the values is not finite.
        """
        wrong = [name for name, value in values.items() if not torch.isfinite(torch.as_tensor(value)).all()]
        if wrong:
            kept = "the last good checkpoint stands; " if self.has_checkpoint else ""
            raise DivergedError(
                f"training diverged in epoch {self.epoch + 1}: {wrong[0]} is not finite; {kept}"
                "try a lower learning_rate or smaller weights"
            )

    def epoch_means(self) -> dict[str, float]:
        """Means of the terms over the epoch and over all devices, sigma, and active dimensions; forgets them."""
        sums = {name: self._mean_over_devices(value) for name, value in self._sums.items()}
        means = {name: value / self._steps for name, value in sums.items()}
        self._sums.clear()
        self._steps = 0
        kl = means.pop("kl_dimensions", None)
        row = {name: float(value) for name, value in means.items() if name != "square"}
        if kl is not None:
            row["active_place"] = float((self.model.split.z_p(kl) > ACTIVE_ABOVE).sum())
            row["active_condition"] = float((self.model.split.z_c(kl) > ACTIVE_ABOVE).sum())
        # The sigma that training reached is fixed from here on: a bound is only ever evaluated with it.
        self.model.log_sigma.copy_(soft_clipped_log_sigma(means["square"]))
        row["sigma"] = float(self.model.log_sigma.exp())
        row["learning_rate"] = float(self.trainer.optimizers[0].param_groups[0]["lr"])
        return row

    def _remember(self, terms: dict[str, Tensor], images: Tensor, output: Output, conditions: Tensor) -> None:
        with torch.no_grad():
            for name, term in terms.items():
                self._sums[name] = self._sums[name] + term.mean()
            self._sums["square"] = self._sums["square"] + (images - output.reconstruction).square().mean()
            if output.posterior.log_variance is not None:
                kl = torch.cat(self.remedies.kl(self.model.split, output.posterior, conditions), dim=1)
                self._sums["kl_dimensions"] = self._sums["kl_dimensions"] + kl.mean(0)
        self._steps += 1

    def _follow_places(self, output: Output, places: Tensor) -> None:
        """Moves the place vectors; with several devices by the frames of all, so that the vectors stay the same."""
        head = self.model.place_head
        if not isinstance(head, PlaceHead):
            return
        z_p = self.model.split.z_p(output.posterior.mean.detach())
        if self.trainer.world_size > 1:
            gathered: Any = self.all_gather((z_p, places))
            z_p, places = (part.flatten(0, 1) for part in gathered)
        head.follow(z_p, places)

    def _place_target(self, batch: Batch) -> Tensor | None:
        if self.model.place_head is None:
            return None
        if self.config.place_spread == 0:
            return batch.places
        return soft_place_targets(batch.places, self.model.config.places, self.config.place_spread)

    def _weights(self, batch_index: int) -> Weights:
        given = self.config.weights
        done = self.epoch + (batch_index + 1) / self._steps_per_epoch
        warm = min(1.0, done / self.config.warmup_epochs) if self.config.warmup_epochs else 1.0
        return Weights(given.image, given.condition, given.place, given.beta_place * warm, given.beta_condition * warm)

    def _step(self, batch_index: int) -> int:
        return self.epoch * self._steps_per_epoch + batch_index

    def _shared_seconds(self) -> float:
        """Seconds as the first device counts them, so that all devices stop at the same step."""
        seconds: Any = self.trainer.strategy.broadcast(self.seconds)
        return float(seconds)

    def _mean_over_devices(self, value: Tensor) -> Tensor:
        mean: Any = self.trainer.strategy.reduce(value.clone(), reduce_op="mean")
        return torch.as_tensor(mean)
