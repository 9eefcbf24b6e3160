"""The terms of the bound for the frames of one step, and the noise that they are sampled with."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from everplace.model.bounds import (
    Weights,
    c_vae_bound,
    cae_objective,
    cp_vae_bound,
    gaussian_log_likelihood,
    label_log_likelihood,
    vae_bound,
)
from everplace.model.condition_vae import ConditionVAE, Output

__all__ = ["bound_terms", "step_noise"]


def step_noise(seed: int, step: int, frames: int, dimensions: int) -> Tensor:
    """The standard normal noise of one step, (frames, dimensions), the same whenever it is drawn."""
    mixed = np.random.SeedSequence((seed, step)).generate_state(1, np.uint64)[0]
    generator = torch.Generator().manual_seed(int(mixed) >> 1)
    return torch.randn(frames, dimensions, generator=generator)


def bound_terms(
    model: ConditionVAE,
    images: Tensor,
    output: Output,
    log_sigma: Tensor,
    labels: tuple[Tensor, Tensor | None],
    weights: Weights,
) -> dict[str, Tensor]:
    """The terms of the model's bound for each frame, (B,), and the bound itself under `bound`.

    The plain autoencoder has no bound and no terms; its objective stands under `bound`.

    Args:
        model: Says which bound it is.
        images: (B, C, H, W) in [0, 1].
        output: What the model made of them.
        log_sigma: The decoder's log sigma.
        labels: Condition indices (B,), and the place target (B,) or (B, K); without a place target the place term
            is left out, as held-out places have no class.
        weights: Weights of the terms.
    """
    if model.config.kind == "cae":
        return {"bound": cae_objective(images, output.reconstruction)}
    kl = output.posterior.kl()
    terms = {
        "image": gaussian_log_likelihood(images, output.reconstruction, log_sigma),
        "kl_place": model.split.z_p(kl).sum(1),
        "kl_condition": model.split.z_c(kl).sum(1),
    }
    conditions, places = labels
    if output.condition_logits is None:
        terms["bound"] = vae_bound(**terms, weights=weights)
        return terms
    terms["condition"] = label_log_likelihood(output.condition_logits, conditions)
    if output.place_logits is None or places is None:
        terms["bound"] = c_vae_bound(**terms, weights=weights)
        return terms
    terms["place"] = label_log_likelihood(output.place_logits, places)
    terms["bound"] = cp_vae_bound(**terms, weights=weights)
    return terms
