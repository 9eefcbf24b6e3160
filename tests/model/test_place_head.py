"""The categorical over the training places: scaled cosines, and vectors that follow the frames."""

from __future__ import annotations

import torch

from everplace.model.place_head import PlaceHead


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
