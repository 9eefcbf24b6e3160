"""One step: a batch to the weighted bound of its model, Eq. 1, 3 or 5 of Oh and Eoh (2021)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from everplace.model.bounds import (
    Weights,
    c_vae_bound,
    cae_objective,
    cp_vae_bound,
    gaussian_log_likelihood,
    label_log_likelihood,
    optimal_log_sigma,
    soft_place_targets,
    vae_bound,
)
from everplace.model.condition_vae import ConditionVAE, Output
from everplace.model.pixels import to_input
from everplace.training.frames import Batch

__all__ = ["BoundStep", "bound_terms", "step_noise"]


class BoundStep(nn.Module):
    """The loss of a batch as one forward pass, so that DDP sees all of it.

    Attributes:
        model: The network.
    """

    def __init__(
        self, model: ConditionVAE, seed: int, place_spread: float = 0.0, rank: int = 0, world: int = 1
    ) -> None:
        """Takes a network.

        Args:
            model: The network, on its device.
            seed: Of the noise.
            place_spread: Standard deviation of the softened place target, in places; 0: one class a frame.
            rank: Index of this device; it takes every `world`-th frame and row of the noise.
            world: Devices on all machines.
        """
        super().__init__()
        self.model = model
        self._seed = seed
        self._place_spread = place_spread
        self._rank, self._world = rank, world

    def forward(self, batch: Batch, step: int, weights: Weights) -> tuple[Tensor, dict[str, Tensor], Tensor]:
        """Encodes, samples, decodes and weighs.

        Args:
            batch: B frames with their labels.
            step: Number of the step in the run, of which the noise is a function.
            weights: Weights of the terms in this step.

        Returns:
            The loss, a scalar: the negative bound, a mean over frames, divided by the number of pixel values. What is
            logged, each a mean over frames: the terms, the squared error `square`, and the KL divergence of each
            dimension, (D,), as `kl_dimensions`. The posterior means of z_p, (B, P), without gradient.
        """
        x = to_input(batch.images)  # (B, C, H, W) in [0, 1]
        noise = self._noise(step, x)  # (B, D) standard normal
        output = self.model(x, noise)  # q(z|x), z (B, D), the mean of p(x|z) (B, C, H, W), logits of the labels
        log_sigma = optimal_log_sigma(x, output.reconstruction)  # scalar
        places = self._place_target(batch.places)  # (B,) or (B, places)
        terms = bound_terms(self.model, x, output, log_sigma, batch.conditions, places, weights)  # each (B,)
        loss = -terms["bound"].mean() / x[0].numel()
        with torch.no_grad():
            means = {name: term.mean() for name, term in terms.items()}
            means["square"] = (x - output.reconstruction).square().mean()
            if output.posterior.log_variance is not None:
                means["kl_dimensions"] = output.posterior.kl().mean(0)
        return loss, means, self.model.split.z_p(output.posterior.mean.detach())

    def _noise(self, step: int, x: Tensor) -> Tensor:
        whole = step_noise(self._seed, step, len(x) * self._world, self.model.config.latent_dimensions)
        return whole[self._rank :: self._world].to(x.device)

    def _place_target(self, places: Tensor) -> Tensor | None:
        if self.model.place_head is None:
            return None
        if self._place_spread == 0:
            return places
        return soft_place_targets(places, self.model.config.places, self._place_spread)


def bound_terms(
    model: ConditionVAE,
    images: Tensor,
    output: Output,
    log_sigma: Tensor,
    conditions: Tensor,
    places: Tensor | None,
    weights: Weights,
) -> dict[str, Tensor]:
    """The terms of the model's bound for each frame, (B,), and the bound itself under `bound`.

    The plain autoencoder has no bound and no terms; its objective stands under `bound`.

    Args:
        model: Says which bound it is.
        images: (B, C, H, W) in [0, 1].
        output: What the model made of them.
        log_sigma: The decoder's log sigma.
        conditions: (B,) indices.
        places: (B,) indices or (B, places) probabilities; None: the place term is left out, as held-out places have
            no class.
        weights: Weights of the terms.
    """
    if model.config.kind == "cae":
        return {"bound": cae_objective(images, output.reconstruction)}
    kl = model.split.blocks(output.posterior.kl())
    terms = {
        "image": gaussian_log_likelihood(images, output.reconstruction, log_sigma),
        **{f"kl_{block}": of_block.sum(1) for block, of_block in kl.items()},
    }
    if output.condition_logits is None:
        return {**terms, "bound": vae_bound(**terms, weights=weights)}
    terms["condition"] = label_log_likelihood(output.condition_logits, conditions)
    if output.place_logits is None or places is None:
        return {**terms, "bound": c_vae_bound(**terms, weights=weights)}
    terms["place"] = label_log_likelihood(output.place_logits, places)
    return {**terms, "bound": cp_vae_bound(**terms, weights=weights)}


def step_noise(seed: int, step: int, frames: int, dimensions: int) -> Tensor:
    """The standard normal noise of one step, (frames, dimensions), the same whenever it is drawn."""
    mixed = np.random.SeedSequence((seed, step)).generate_state(1, np.uint64)[0]
    generator = torch.Generator().manual_seed(int(mixed) >> 1)
    return torch.randn(frames, dimensions, generator=generator)
