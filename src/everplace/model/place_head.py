"""p(p|z_p): which training place a latent shows, told apart as classes or by the position along the route."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

__all__ = ["PlaceHead", "PositionHead"]


class PlaceHead(nn.Module):
    """p(p|z_p): a categorical over the training places by scaled cosine.

    The logits are a learned scale times the cosine between z_p and a vector of each place, so that what the head is
    trained to tell apart is what Eq. 6 compares. The vector of a place is a moving average of the posterior means of
    its frames and not a free parameter (the non-parametric softmax of Wu et al. 2018): a place has as many frames as
    there are conditions, too few to learn 96 numbers from by gradient. Decided; the paper is silent.

    Attributes:
        places: (places, dimensions), the vectors, of length 1.
        log_scale: Logarithm of the scale.
    """

    KEPT = 0.5
    """Share of a place's vector that one step leaves as it is."""

    places: Tensor

    def __init__(self, dimensions: int, places: int) -> None:
        super().__init__()
        self.register_buffer("places", functional.normalize(torch.randn(places, dimensions), dim=1))
        self.log_scale = nn.Parameter(torch.tensor(2.5))

    def forward(self, z_p: Tensor) -> Tensor:
        """(B, D) to logits (B, K)."""
        # A copy, because the vectors move on before the gradient of this step is taken.
        cosine = functional.linear(functional.normalize(z_p, dim=1), self.places.clone())
        return cosine * self.log_scale.exp()

    @torch.no_grad()
    def follow(self, z_p: Tensor, places: Tensor) -> None:
        """Moves the vectors of the places that a step has seen towards their frames.

        Args:
            z_p: (B, D), the frames' posterior means.
            places: (B,), their places; a place may occur more than once.
        """
        seen, position = torch.unique(places, return_inverse=True)
        sums = z_p.new_zeros(len(seen), z_p.shape[1]).index_add_(0, position, functional.normalize(z_p, dim=1))
        mean = functional.normalize(sums, dim=1)
        moved = self.KEPT * self.places[seen] + (1.0 - self.KEPT) * mean
        self.places[seen] = functional.normalize(moved, dim=1)


class PositionHead(nn.Module):
    """p(p|z_p): the position along the route, regressed (the ablation of `PlaceHead`).

    A linear function of z_p says where on the route a frame was taken, with Gaussian noise of one learned deviation.
    The Gaussian is taken at the training places alone and normalised over them, so that the likelihood is that of a
    label, as for `PlaceHead`, and both take part in the bound in the same way. Decided; the paper is silent.

    Attributes:
        positions: (places,), evenly from -1 to 1 along the route.
        log_deviation: Logarithm of the noise's standard deviation.
    """

    positions: Tensor

    def __init__(self, dimensions: int, places: int) -> None:
        super().__init__()
        self.register_buffer("positions", torch.linspace(-1.0, 1.0, places))
        self.position = nn.Linear(dimensions, 1)
        self.log_deviation = nn.Parameter(torch.tensor(0.0))

    def forward(self, z_p: Tensor) -> Tensor:
        """(B, D) to logits (B, K)."""
        distance: Tensor = self.position(z_p) - self.positions
        return -0.5 * (distance * torch.exp(-self.log_deviation)).square()

    def follow(self, z_p: Tensor, places: Tensor) -> None:
        """Nothing moves: the positions are given."""
