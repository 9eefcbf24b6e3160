"""The contrastive term: against an independent computation, its bounds and invariances, and where gradients go."""

from __future__ import annotations

import math

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.model.remedies import info_nce


def drawn(seed: int, places: int = 6, dimensions: int = 4) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return tuple(torch.randn(places, dimensions, generator=generator) for _ in range(2))  # type: ignore[return-value]


def test_against_probabilities_written_out_in_numpy() -> None:
    first, second = drawn(1)
    a = first.numpy() / np.linalg.norm(first.numpy(), axis=1, keepdims=True)
    b = second.numpy() / np.linalg.norm(second.numpy(), axis=1, keepdims=True)
    expected = []
    for place in range(len(a)):
        forth = [math.exp(float(a[place] @ other) / 0.2) for other in b]
        back = [math.exp(float(b[place] @ other) / 0.2) for other in a]
        expected.append(0.5 * (math.log(forth[place] / sum(forth)) + math.log(back[place] / sum(back))))
    np.testing.assert_allclose(info_nce(first, second, 0.2).numpy(), expected, rtol=1e-5)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), scale=st.floats(0.1, 50.0), temperature=st.floats(0.05, 2.0))
def test_at_most_nought_and_blind_to_length_and_to_which_frame_is_first(
    seed: int, scale: float, temperature: float
) -> None:
    first, second = drawn(seed)
    term = info_nce(first, second, temperature)
    assert (term <= 0).all()
    torch.testing.assert_close(info_nce(scale * first, second, temperature), term, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(info_nce(second, first, temperature), term)


def test_equal_frames_far_from_the_others_reach_nought_and_equal_places_the_logarithm_of_their_number() -> None:
    apart = torch.eye(5)
    assert info_nce(apart, apart, 0.01).abs().max() < 1e-6
    alike = torch.ones(5, 3)
    torch.testing.assert_close(info_nce(alike, alike, 0.07), torch.full((5,), -math.log(5.0)))


def test_gradient_draws_the_frames_of_a_place_together() -> None:
    first, second = drawn(3)
    first.requires_grad_()
    before = info_nce(first, second, 0.1).sum()
    (gradient,) = torch.autograd.grad(before, first)
    assert info_nce(first + 0.01 * gradient, second, 0.1).sum() > before
