"""Remedies: terms that the paper's bound does not have; off in the faithful models."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from everplace.model.posterior import Posterior

__all__ = ["ConditionAdversary", "ConditionalPrior", "free_bits", "info_nce", "reversal_strength", "reverse_gradient"]


def info_nce(first: Tensor, second: Tensor, temperature: float, places: Tensor | None = None) -> Tensor:
    """Contrastive place term between the conditions (InfoNCE, van den Oord et al. 2018; SimCLR's symmetric form).

    Each frame is to find the other frame of its place among those of all places in the batch, by the cosine of
    Eq. 6. It is the categorical log p(p|z_p) over the places of the batch, each represented by its other frame.

    Args:
        first: (P, D), z_p of one frame of each place.
        second: (P, D), z_p of another frame of each place.
        temperature: What the cosine is divided by.
        places: (P,), which place each is; another pair of the same place is no wrong answer and does not take part.
            None: all are different.

    Returns:
        (P,) in nats, at most 0: the mean of both directions.
    """
    cosine = functional.normalize(first, dim=1) @ functional.normalize(second, dim=1).T
    own = torch.arange(len(first), device=first.device)
    if places is not None:
        doubled = (places[:, None] == places[None, :]) & (own[:, None] != own[None, :])
        cosine = cosine.masked_fill(doubled, -torch.inf)
    forth = functional.cross_entropy(cosine / temperature, own, reduction="none")
    back = functional.cross_entropy(cosine.T / temperature, own, reduction="none")
    return -0.5 * (forth + back)


class _ReverseGradient(torch.autograd.Function):
    @staticmethod
    def forward(context: Any, x: Tensor, strength: float) -> Tensor:
        context.strength = strength
        return x.view_as(x)

    @staticmethod
    def backward(context: Any, gradient: Tensor) -> tuple[Tensor, None]:
        return -context.strength * gradient, None


def reverse_gradient(x: Tensor, strength: float) -> Tensor:
    """The gradient reversal layer (Ganin et al. 2016, Section 4.2): R(x) = x, dR/dx = -strength I.

    Args:
        x: Any shape.
        strength: The paper's lambda, what the gradient is multiplied by beside -1.

    Returns:
        The values of `x`.
    """
    reversed_gradient: Tensor = _ReverseGradient.apply(x, strength)  # type: ignore[no-untyped-call]
    return reversed_gradient


def reversal_strength(progress: float) -> float:
    """How strongly the gradient is reversed: 2 / (1 + exp(-10 p)) - 1 (Ganin et al. 2016, Section 5.2.2).

    The encoder is left alone by an adversary that has not learned anything yet.

    Args:
        progress: How much of the run is done, p in [0, 1].

    Returns:
        0 at the start, nearly 1 from the middle on.
    """
    return 2.0 / (1.0 + math.exp(-10.0 * progress)) - 1.0


class ConditionAdversary(nn.Module):
    """A classifier of the condition from z_p behind a gradient reversal layer (DANN, Ganin et al. 2016).

    The classifier learns to tell the condition, and the encoder to leave nothing in z_p that it could tell it by.
    It has the shape of the paper's smaller one, x→100→classes with a rectifier. It is trained, and never used again.

    Decided: its inputs are standardised over the batch. Without, the encoder makes z_p ever longer, by which a
    classifier's wrong guesses cost without limit, and which the cosine of Eq. 6 does not see.
    """

    HIDDEN = 100

    def __init__(self, dimensions: int, conditions: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(dimensions, self.HIDDEN), nn.ReLU(), nn.Linear(self.HIDDEN, conditions)
        )  # fmt: skip

    def forward(self, z_p: Tensor, strength: float) -> Tensor:
        """Guesses the condition.

        Args:
            z_p: (B, D), the posterior means; B at least 2. The paper's feature is deterministic and what is used at
                test time, which is the descriptor; the noise of a sample would hide what a probe of that finds.
            strength: Of the reversal.

        Returns:
            Logits (B, conditions).
        """
        standardised = functional.batch_norm(reverse_gradient(z_p, strength), None, None, training=True)
        logits: Tensor = self.layers(standardised)
        return logits


class ConditionalPrior(nn.Module):
    """p(z_c|c), a diagonal Gaussian for each condition (DIVA, Ilse et al. 2020; iVAE, Khemakhem et al. 2020).

    It starts as N(0, I), the prior of the faithful bound, for every condition.

    Attributes:
        mean: (conditions, D).
        log_variance: (conditions, D), natural logarithm.
    """

    def __init__(self, conditions: int, dimensions: int) -> None:
        super().__init__()
        self.mean = nn.Parameter(torch.zeros(conditions, dimensions))
        self.log_variance = nn.Parameter(torch.zeros(conditions, dimensions))

    def kl(self, z_c: Posterior, conditions: Tensor) -> Tensor:
        """KL(q(z_c|x) || p(z_c|c)) of each frame and dimension.

        With q = N(m, s²) and p = N(n, t²) it is log t/s + (s² + (m - n)²) / 2t² - 1/2.

        Args:
            z_c: The posterior of the block z_c, (B, D).
            conditions: (B,) indices.

        Returns:
            (B, D) in nats, never negative.
        """
        assert z_c.log_variance is not None
        mean, log_variance = self.mean[conditions], self.log_variance[conditions]
        square = z_c.log_variance.exp() + (z_c.mean - mean).square()
        return 0.5 * (log_variance - z_c.log_variance + square * torch.exp(-log_variance) - 1.0)


def free_bits(kl: Tensor, nats: float) -> Tensor:
    """What a divergence costs when some of it is free (Kingma et al. 2016, Appendix C.8).

    The sum over dimensions j of max(λ, mean over the batch of KL_j): no dimension gains by holding less than λ. The
    paper lets groups of dimensions share a λ; here each dimension is a group of its own.

    Args:
        kl: (B, D), KL divergence of each frame and dimension.
        nats: λ, for each dimension.

    Returns:
        Scalar in nats, for one frame.
    """
    return kl.mean(0).clamp(min=nats).sum()
