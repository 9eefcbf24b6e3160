"""Remedies: terms that the paper's bound does not have; off in the faithful models."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

__all__ = ["info_nce"]


def info_nce(first: Tensor, second: Tensor, temperature: float) -> Tensor:
    """Contrastive place term between the conditions (InfoNCE, van den Oord et al. 2018; SimCLR's symmetric form).

    Each frame is to find the other frame of its place among those of all places in the batch, by the cosine of
    Eq. 6. It is the categorical log p(p|z_p) over the places of the batch, each represented by its other frame.

    Args:
        first: (P, D), z_p of one frame of each place.
        second: (P, D), z_p of another frame of each place.
        temperature: What the cosine is divided by.

    Returns:
        (P,) in nats, at most 0: the mean of both directions.
    """
    cosine = functional.normalize(first, dim=1) @ functional.normalize(second, dim=1).T
    places = torch.arange(len(first), device=first.device)
    forth = functional.cross_entropy(cosine / temperature, places, reduction="none")
    back = functional.cross_entropy(cosine.T / temperature, places, reduction="none")
    return -0.5 * (forth + back)
