"""The variational lower bounds of Oh and Eoh (2021), one function an equation.

All terms are in nats for each frame of a batch, (B,): log-likelihoods are summed over pixels, the KL divergence over
latent dimensions. With all weights 1 (`Weights()`) each function is a lower bound of the log-likelihood of its
generative model; with other weights it is the weighted objective that is trained and is no bound any more.
"""

from __future__ import annotations

import math
from typing import Annotated

import torch
from pydantic import Field
from torch import Tensor
from torch.nn import functional

from everplace.settings import Settings

__all__ = [
    "LOG_SIGMA_FLOOR",
    "Weights",
    "c_vae_bound",
    "cae_objective",
    "cp_vae_bound",
    "gaussian_log_likelihood",
    "label_log_likelihood",
    "optimal_log_sigma",
    "soft_clipped_log_sigma",
    "soft_place_targets",
    "vae_bound",
]

LOG_SIGMA_FLOOR = -6.0
"""Where log sigma is softly clipped below (Rybkin et al. 2021): a perfect reconstruction has no infinite likelihood."""


_Weight = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Weights(Settings):
    """Weights of the terms of a bound ("weighted Eq. 1, 3, 5"); all 1 is the bound as the paper writes it."""

    image: _Weight = 1.0
    """Of log p(x|z), summed over pixels."""
    condition: _Weight = 1.0
    """Of log p(c|z_c)."""
    place: _Weight = 1.0
    """Of log p(p|z_p)."""
    beta_place: _Weight = 1.0
    """Of the KL divergence of z_p, after the warm-up."""
    beta_condition: _Weight = 1.0
    """Of the KL divergence of z_c, after the warm-up."""


def vae_bound(image: Tensor, kl_place: Tensor, kl_condition: Tensor, weights: Weights) -> Tensor:
    """Eq. 1: E_q[log p(x|z)] - KL(q(z|x) || p(z)).

    Args:
        image: log p(x|z), (B,).
        kl_place: KL of the block z_p, (B,).
        kl_condition: KL of the block z_c, (B,). For the plain VAE the two blocks together are its z.
        weights: Weights of the terms.

    Returns:
        (B,) in nats.
    """
    divergence = weights.beta_place * kl_place + weights.beta_condition * kl_condition
    return weights.image * image - divergence


def c_vae_bound(image: Tensor, condition: Tensor, kl_place: Tensor, kl_condition: Tensor, weights: Weights) -> Tensor:
    """Eq. 3: E_q[log p(x|z_p,z_c) + log p(c|z_c)] - KL(q(z_p,z_c|x) || p(z_p) p(z_c)).

    Args:
        image: log p(x|z), (B,).
        condition: log p(c|z_c), (B,).
        kl_place: KL of the block z_p, (B,).
        kl_condition: KL of the block z_c, (B,).
        weights: Weights of the terms.

    Returns:
        (B,) in nats.
    """
    return vae_bound(image, kl_place, kl_condition, weights) + weights.condition * condition


def cp_vae_bound(
    image: Tensor, place: Tensor, condition: Tensor, kl_place: Tensor, kl_condition: Tensor, weights: Weights
) -> Tensor:
    """Eq. 5: E_q[log p(x|z_p,z_c) + log p(p|z_p) + log p(c|z_c)] - KL(q(z_p,z_c|x) || p(z_p) p(z_c)).

    Args:
        image: log p(x|z), (B,).
        place: log p(p|z_p), (B,).
        condition: log p(c|z_c), (B,).
        kl_place: KL of the block z_p, (B,).
        kl_condition: KL of the block z_c, (B,).
        weights: Weights of the terms.

    Returns:
        (B,) in nats.
    """
    return c_vae_bound(image, condition, kl_place, kl_condition, weights) + weights.place * place


def cae_objective(images: Tensor, reconstruction: Tensor) -> Tensor:
    """The negative squared error, the objective of the plain convolutional autoencoder; no bound of anything.

    Args:
        images: (B, C, H, W).
        reconstruction: (B, C, H, W).

    Returns:
        (B,), summed over the pixels of each frame.
    """
    return -(images - reconstruction).square().flatten(1).sum(1)


def optimal_log_sigma(images: Tensor, reconstruction: Tensor) -> Tensor:
    """The log sigma that maximises the batch's likelihood, in closed form (sigma-VAE, Rybkin et al. 2021, Eq. 6).

    It couples the frames of a batch: use it to train; evaluate a bound with the fixed sigma of the checkpoint.

    Args:
        images: (B, C, H, W).
        reconstruction: (B, C, H, W), the decoder's mean.

    Returns:
        Scalar.
    """
    return soft_clipped_log_sigma((images - reconstruction).square().mean())


def soft_clipped_log_sigma(mean_square: Tensor) -> Tensor:
    """The log of the root of a mean squared error, softly clipped below at `LOG_SIGMA_FLOOR`.

    Args:
        mean_square: Scalar, mean over frames and pixel values.

    Returns:
        Scalar.
    """
    log_sigma = 0.5 * torch.log(mean_square + 1e-12)
    return LOG_SIGMA_FLOOR + functional.softplus(log_sigma - LOG_SIGMA_FLOOR)


def gaussian_log_likelihood(images: Tensor, reconstruction: Tensor, log_sigma: Tensor) -> Tensor:
    """Log N(x; reconstruction, sigma^2 I), summed over the pixels of each frame.

    Args:
        images: (B, C, H, W).
        reconstruction: (B, C, H, W), the decoder's mean.
        log_sigma: Scalar, one variance shared by all pixels.

    Returns:
        (B,) in nats.
    """
    square = (images - reconstruction).square().flatten(1).sum(1)
    pixels = images[0].numel()
    return -0.5 * square * torch.exp(-2.0 * log_sigma) - pixels * (log_sigma + 0.5 * math.log(2.0 * math.pi))


def label_log_likelihood(logits: Tensor, targets: Tensor) -> Tensor:
    """Log p(label|z) of a categorical head.

    Args:
        logits: (B, K).
        targets: (B,) class indices, or (B, K) probabilities for a softened target (the expected log-likelihood
            under that target).

    Returns:
        (B,) in nats, at most 0.
    """
    return -functional.cross_entropy(logits, targets, reduction="none")


def soft_place_targets(places: Tensor, count: int, spread: float) -> Tensor:
    """Softens a place label over its neighbours along the route, as their frames overlap.

    Args:
        places: (B,) indices in [0, count).
        count: Number of places K.
        spread: Standard deviation in places of the Gaussian that shares the label out; greater than 0.

    Returns:
        (B, K), rows sum to 1.
    """
    along = torch.arange(count, device=places.device, dtype=torch.float32)
    return torch.softmax(-0.5 * ((along[None, :] - places[:, None]) / spread).square(), dim=1)
