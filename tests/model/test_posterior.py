"""The diagonal Gaussian against torch.distributions, and the order of z = [z_p, z_c]."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.distributions import Independent, Normal, kl_divergence

from everplace.model.posterior import LatentSplit, Posterior

MEANS = st.lists(st.floats(-20, 20, width=32), min_size=3, max_size=3)
LOG_VARIANCES = st.lists(st.floats(-10, 10, width=32), min_size=3, max_size=3)


@given(MEANS, LOG_VARIANCES)
@settings(max_examples=50, deadline=None)
def test_kl_equals_that_of_torch_distributions(means: list[float], log_variances: list[float]) -> None:
    mean = torch.tensor([means], dtype=torch.float64)
    log_variance = torch.tensor([log_variances], dtype=torch.float64)
    posterior = Posterior(mean, log_variance)
    q = Normal(mean, torch.exp(0.5 * log_variance))
    expected = kl_divergence(q, Normal(torch.zeros_like(mean), torch.ones_like(mean)))
    torch.testing.assert_close(posterior.kl(), expected, rtol=1e-10, atol=1e-12)
    whole = kl_divergence(Independent(q, 1), Independent(Normal(torch.zeros_like(mean), torch.ones_like(mean)), 1))
    torch.testing.assert_close(posterior.kl().sum(1), whole, rtol=1e-10, atol=1e-12)


def test_kl_of_the_prior_is_zero() -> None:
    assert torch.equal(Posterior(torch.zeros(2, 4), torch.zeros(2, 4)).kl(), torch.zeros(2, 4))


def test_sample_has_the_mean_and_the_variance() -> None:
    noise = torch.randn(200_000, 2, generator=torch.Generator().manual_seed(1))
    mean = torch.tensor([[3.0, -1.0]]).expand(200_000, 2)
    log_variance = torch.tensor([[4.0, 0.25]]).log().expand(200_000, 2)
    z = Posterior(mean, log_variance).sample(noise)
    torch.testing.assert_close(z.mean(0), torch.tensor([3.0, -1.0]), rtol=0, atol=0.02)
    torch.testing.assert_close(z.var(0), torch.tensor([4.0, 0.25]), rtol=0.02, atol=0)


def test_z_p_comes_first() -> None:
    split = LatentSplit(place=3, condition=2)
    z = torch.arange(10.0).view(2, 5)
    assert torch.equal(split.z_p(z), torch.tensor([[0.0, 1.0, 2.0], [5.0, 6.0, 7.0]]))
    assert torch.equal(split.z_c(z), torch.tensor([[3.0, 4.0], [8.0, 9.0]]))
    assert torch.equal(split.join(split.z_p(z), split.z_c(z)), z)


def test_join_refuses_swapped_blocks() -> None:
    split = LatentSplit(place=96, condition=32)
    with pytest.raises(ValueError, match="sizes 96 and 32, not 32 and 96"):
        split.join(torch.zeros(1, 32), torch.zeros(1, 96))
