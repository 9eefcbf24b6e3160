"""What a latent tells of its training place: scaled cosines with vectors that follow the frames, or a position."""

from __future__ import annotations

import numpy as np
import torch
from scipy.stats import norm

from everplace.model.bounds import label_log_likelihood
from everplace.model.place_head import PlaceHead, PositionHead


def test_place_logits_are_scaled_cosines() -> None:
    head = PlaceHead(dimensions=3, places=2)
    with torch.no_grad():
        head.places.copy_(torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]))
        head.log_scale.fill_(0.0)
        logits = head(torch.tensor([[5.0, 0.0, 0.0], [1.0, 1.0, 0.0]]))
    assert torch.allclose(logits, torch.tensor([[1.0, 0.0], [0.5**0.5, 0.6 * 0.5**0.5]]))


def test_place_vectors_follow_the_frames_that_were_seen() -> None:
    head = PlaceHead(dimensions=2, places=3)
    head.places.copy_(torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]]))
    # Place 0 is seen twice, at right angles; place 1 once; place 2 not at all.
    head.follow(torch.tensor([[3.0, 0.0], [0.0, 7.0], [2.0, 0.0]]), torch.tensor([0, 0, 1]))
    half = 0.5**0.5
    towards_both = torch.tensor([0.5 + 0.5 * half, 0.5 * half])
    expected = torch.stack([towards_both / towards_both.norm(), torch.tensor([half, half]), torch.tensor([0.6, 0.8])])
    assert torch.allclose(head.places, expected)


def test_place_vectors_may_move_before_the_gradient_is_taken() -> None:
    head = PlaceHead(dimensions=4, places=3)
    z_p = torch.randn(2, 4, generator=torch.Generator().manual_seed(0)).requires_grad_()
    expected = torch.autograd.grad(head(z_p)[:, 1].sum(), z_p)[0]
    logits = head(z_p)[:, 1].sum()
    head.follow(z_p, torch.tensor([1, 2]))
    assert torch.equal(torch.autograd.grad(logits, z_p)[0], expected)


def test_the_position_has_a_normal_distribution_over_the_places() -> None:
    head = PositionHead(dimensions=2, places=5)
    with torch.no_grad():
        head.position.weight.copy_(torch.tensor([[0.5, -1.0]]))
        head.position.bias.fill_(0.1)
        head.log_deviation.fill_(np.log(0.3))
        z_p = torch.tensor([[0.4, 0.2], [-2.0, 0.5]])
        found = label_log_likelihood(head(z_p), torch.tensor([3, 0]))
    density = norm.pdf(np.linspace(-1, 1, 5), loc=np.array([[0.1], [-1.4]]), scale=0.3)
    expected = np.log(density / density.sum(axis=1, keepdims=True))[[0, 1], [3, 0]]
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-5)


def test_the_position_is_learned_by_gradient() -> None:
    generator = torch.Generator().manual_seed(1)
    places = torch.arange(40)
    along = torch.linspace(-2, 3, 40)
    z_p = torch.stack([along, 0.5 - along], dim=1) + 0.05 * torch.randn(40, 2, generator=generator)
    with torch.random.fork_rng():
        torch.manual_seed(3)
        head = PositionHead(dimensions=2, places=40)
    optimizer = torch.optim.Adam(head.parameters(), lr=0.01)
    for _ in range(900):
        optimizer.zero_grad()
        torch.autograd.backward(-label_log_likelihood(head(z_p), places).mean())
        optimizer.step()
    assert (head(z_p).argmax(dim=1) - places).abs().float().mean() < 1
    assert -label_log_likelihood(head(z_p), places).mean() < np.log(40) / 2
