"""The diagonal Gaussian posterior q(z|x) and the one place that knows the order of z = [z_p, z_c]."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Any, TypeVar

import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["ACTIVE_ABOVE", "BLOCKS", "LatentSplit", "Posterior"]

BLOCKS = {"place": "z_p", "condition": "z_c"}
"""The blocks of the latent in their order, each with its symbol in the paper."""

_Array = TypeVar("_Array", Tensor, NDArray[Any])

ACTIVE_ABOVE = 0.01
"""A latent dimension whose mean KL divergence is above this, in nats, is counted as active."""


@dataclass(frozen=True, slots=True)
class LatentSplit:
    """How z is divided: z_p first, then z_c (Oh and Eoh 2021, Section 3).

    Everything that needs one of the two blocks asks here, so that the order cannot silently be swapped.

    Attributes:
        place: Size of z_p.
        condition: Size of z_c.
    """

    place: int
    condition: int

    def blocks(self, z: _Array) -> dict[str, _Array]:
        """All blocks of a tensor or an array, (..., size), by their names in `BLOCKS`."""
        sizes = (self.place, self.condition)
        ends = accumulate(sizes)
        return {name: z[..., end - size : end] for name, size, end in zip(BLOCKS, sizes, ends, strict=True)}

    def z_p(self, z: _Array) -> _Array:
        """The condition-invariant block, (..., place)."""
        return self.blocks(z)["place"]

    def z_c(self, z: _Array) -> _Array:
        """The condition-sensitive block, (..., condition)."""
        return self.blocks(z)["condition"]

    def join(self, z_p: Tensor, z_c: Tensor) -> Tensor:
        """Builds z = [z_p, z_c] from its blocks.

        Raises:
            ValueError: A block has another size than this split, which is how a swap shows itself.
        """
        if z_p.shape[-1] != self.place or z_c.shape[-1] != self.condition:
            raise ValueError(
                f"z_p and z_c must have sizes {self.place} and {self.condition}, "
                f"not {z_p.shape[-1]} and {z_c.shape[-1]}"
            )
        return torch.cat([z_p, z_c], dim=-1)


@dataclass(frozen=True, slots=True)
class Posterior:
    """q(z|x) = N(mean, diag(exp(log_variance))) for a batch, or the one code of a deterministic encoder.

    Attributes:
        mean: (B, D).
        log_variance: (B, D), natural logarithm; None for the code of an autoencoder, which is a point.
    """

    mean: Tensor
    log_variance: Tensor | None

    def sample(self, noise: Tensor) -> Tensor:
        """Reparameterised sample, z = mean + std * noise (Kingma and Welling 2014).

        Args:
            noise: (B, D) standard normal; the caller draws it, so that it can be repeated exactly. A code needs none.
        """
        if self.log_variance is None:
            return self.mean
        return self.mean + torch.exp(0.5 * self.log_variance) * noise

    def kl(self) -> Tensor:
        """KL(q(z|x) || N(0, I)) of each frame and dimension in nats, (B, D), never negative.

        Raises:
            ValueError: The posterior is a point, whose divergence from a density is infinite.
        """
        if self.log_variance is None:
            raise ValueError("the code of an autoencoder is a point and has no KL divergence from a density")
        return 0.5 * (self.mean.square() + self.log_variance.exp() - 1.0 - self.log_variance)
