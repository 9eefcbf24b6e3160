"""Remedies: against independent computations, their bounds and invariances, and where gradients go."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.model.posterior import Posterior
from everplace.model.remedies import (
    ConditionAdversary,
    ConditionalPrior,
    free_bits,
    info_nce,
    reversal_strength,
    reverse_gradient,
)


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


def test_another_pair_of_the_same_place_is_no_wrong_answer() -> None:
    first, second = drawn(2)
    places = torch.tensor([7, 3, 7, 5, 9, 7])
    found = info_nce(first, second, 0.2, places)
    for pair, others in enumerate([[1, 3, 4], [0, 2, 3, 4, 5], [1, 3, 4], [0, 1, 2, 4, 5], [0, 1, 2, 3, 5], [1, 3, 4]]):
        kept = [pair, *others]
        torch.testing.assert_close(found[pair], info_nce(first[kept], second[kept], 0.2)[0])
    torch.testing.assert_close(info_nce(first, second, 0.2, torch.arange(6)), info_nce(first, second, 0.2))


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


def test_a_reversed_gradient_is_exactly_the_plain_one_times_minus_the_strength() -> None:
    first, second = drawn(4)
    for strength in (0.0, 0.25, 1.0, 8.0):
        x = first.clone().requires_grad_()
        assert torch.equal(reverse_gradient(x, strength), x)
        (plain,) = torch.autograd.grad((x.sin() * second).sum(), x)
        (turned,) = torch.autograd.grad((reverse_gradient(x, strength).sin() * second).sum(), x)
        assert torch.equal(turned, -strength * plain)


def test_the_reversal_sets_in_as_in_the_paper() -> None:
    assert reversal_strength(0.0) == 0.0
    # tanh(5p) is another way to write it.
    for progress in (0.05, 0.3, 0.5, 1.0):
        assert reversal_strength(progress) == pytest.approx(math.tanh(5.0 * progress))


def test_an_adversary_learns_what_its_features_unlearn() -> None:
    with torch.random.fork_rng():
        torch.manual_seed(5)
        adversary = ConditionAdversary(4, 2)
    z_p, _ = drawn(5)
    z_p.requires_grad_()
    conditions = torch.tensor([0, 1, 0, 1, 1, 0])

    def loss(features: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.cross_entropy(adversary(features, 0.5), conditions)

    of_all = [z_p, *adversary.parameters()]
    gradients = torch.autograd.grad(loss(z_p), of_all)
    standardised = (z_p - z_p.mean(0)) / (z_p.var(0, correction=0) + 1e-5).sqrt()
    plain = torch.autograd.grad(torch.nn.functional.cross_entropy(adversary.layers(standardised), conditions), of_all)
    torch.testing.assert_close(gradients[0], -0.5 * plain[0])
    for one, other in zip(gradients[1:], plain[1:], strict=True):
        torch.testing.assert_close(one, other)
    with torch.no_grad():
        before = float(loss(z_p))
        assert float(loss(z_p - 0.1 * gradients[0])) > before
        for parameter, gradient in zip(adversary.parameters(), gradients[1:], strict=True):
            parameter.sub_(0.01 * gradient)
        assert float(loss(z_p)) < before


def test_an_adversary_is_not_fooled_by_length() -> None:
    adversary = ConditionAdversary(4, 2)
    z_p, _ = drawn(7)
    torch.testing.assert_close(adversary(1000.0 * z_p, 1.0), adversary(z_p, 1.0), atol=1e-3, rtol=1e-3)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), spread=st.floats(0.1, 3.0))
def test_divergence_from_the_conditional_prior_is_that_of_torch_distributions(seed: int, spread: float) -> None:
    (mean, log_variance), (means, log_variances) = drawn(seed), drawn(seed + 1, places=3)
    conditions = torch.tensor([2, 0, 1, 1, 0, 2])
    prior = ConditionalPrior(3, 4)
    with torch.no_grad():
        prior.mean.copy_(spread * means)
        prior.log_variance.copy_(log_variances)
        kl = prior.kl(Posterior(mean, log_variance), conditions)
    expected = torch.distributions.kl_divergence(
        torch.distributions.Normal(mean, (0.5 * log_variance).exp()),
        torch.distributions.Normal(spread * means[conditions], (0.5 * log_variances[conditions]).exp()),
    )
    torch.testing.assert_close(kl, expected, rtol=1e-4, atol=1e-5)
    assert (kl >= -1e-6).all()


def test_a_conditional_prior_starts_as_the_faithful_one() -> None:
    mean, log_variance = drawn(6)
    posterior = Posterior(mean, log_variance)
    kl = ConditionalPrior(2, 4).kl(posterior, torch.tensor([0, 1, 1, 0, 0, 1]))
    torch.testing.assert_close(kl, posterior.kl())


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 1000), nats=st.floats(0.0, 3.0))
def test_free_bits_against_a_loop(seed: int, nats: float) -> None:
    kl = drawn(seed)[0].square()
    expected = sum(max(nats, sum(float(kl[b, j]) for b in range(6)) / 6) for j in range(4))
    assert float(free_bits(kl, nats)) == pytest.approx(expected, rel=1e-5)


def test_a_dimension_below_its_free_bits_feels_nothing_and_one_above_them_all() -> None:
    kl = torch.tensor([[0.1, 2.0], [0.3, 1.0]], requires_grad=True)
    (gradient,) = torch.autograd.grad(free_bits(kl, 0.5), kl)
    # The mean of the first is 0.2, of the second 1.5.
    assert gradient.tolist() == [[0.0, 0.5], [0.0, 0.5]]
