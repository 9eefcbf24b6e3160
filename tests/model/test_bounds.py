"""The bounds against numerical integration and exact results, and each term against its formula."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar
from torch import Tensor
from torch.distributions import MultivariateNormal, Normal
from torch.nn import functional

from everplace.model.bounds import (
    LOG_SIGMA_FLOOR,
    Weights,
    c_vae_bound,
    cp_vae_bound,
    gaussian_log_likelihood,
    label_log_likelihood,
    optimal_log_sigma,
    soft_clipped_log_sigma,
    soft_place_targets,
    vae_bound,
)
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.model.posterior import Posterior

KINDS = ("vae", "c-vae", "cp-vae")


@dataclass(frozen=True)
class Terms:
    """Log-likelihoods of one frame at many points of the latent plane, (points,)."""

    image: Tensor
    condition: Tensor
    place: Tensor

    def joint(self, kind: str) -> Tensor:
        """Log-likelihood of all that the kind generates, given z."""
        total = self.image
        if kind != "vae":
            total = total + self.condition
        if kind == "cp-vae":
            total = total + self.place
        return total


def bound(kind: str, expected: Terms, kl: Tensor, weights: Weights) -> Tensor:
    """The bound of a kind from expected terms and the KL of each of the two latent dimensions."""
    kl_place, kl_condition = kl[:, 0], kl[:, 1]
    if kind == "vae":
        return vae_bound(expected.image, kl_place, kl_condition, weights)
    if kind == "c-vae":
        return c_vae_bound(expected.image, expected.condition, kl_place, kl_condition, weights)
    return cp_vae_bound(expected.image, expected.place, expected.condition, kl_place, kl_condition, weights)


@pytest.fixture(scope="module")
def tiny() -> tuple[ConditionVAE, Posterior, Tensor, Terms]:
    """The real classes with one dimension a block: model, q(z|x) of one frame, a grid over z, the terms on it."""
    config = ModelConfig(
        kind="cp-vae", height=32, width=32, channels=1, conditions=("summer", "winter"), places=3,
        place_dimensions=1, condition_dimensions=1, fully_connected=False,
    )  # fmt: skip
    with torch.random.fork_rng(), torch.no_grad():
        torch.manual_seed(11)
        model = ConditionVAE(config)
        # Settles the normalisation, so that the untrained networks depend on their inputs.
        for _ in range(20):
            model(torch.rand(16, 1, 32, 32), torch.randn(16, 2))
        model.eval()
        # With sigma 2 the likelihood is neither flat nor too narrow for the grid.
        model.log_sigma.fill_(math.log(2.0))
        image = model.decoder(torch.tensor([[0.7, -1.1]])) + 0.3 * torch.randn(1, 1, 32, 32)
        # No grid line at z_p = 0, where the cosine of a one-dimensional z_p jumps.
        line = torch.arange(-5.875, 6.0, 0.25)
        z = torch.cartesian_prod(line, line)
        decoded = torch.cat([model.decoder(part) for part in torch.split(z, 600)])
        assert model.condition_head is not None
        assert model.place_head is not None
        label = torch.zeros(len(z), dtype=torch.long)
        terms = Terms(
            gaussian_log_likelihood(image.expand_as(decoded), decoded, model.log_sigma).double(),
            label_log_likelihood(model.condition_head(model.split.z_c(z)), label + 1).double(),
            label_log_likelihood(model.place_head(model.split.z_p(z)), label + 2).double(),
        )
        posterior = model.encoder(image)
    return model, Posterior(posterior.mean.double(), posterior.log_variance.double()), z.double(), terms


@pytest.mark.parametrize("kind", KINDS)
def test_bound_is_the_integrated_log_likelihood_less_the_divergence_of_q(
    kind: str, tiny: tuple[ConditionVAE, Posterior, Tensor, Terms]
) -> None:
    _, posterior, z, terms = tiny
    assert posterior.log_variance is not None
    cell = 0.25**2
    log_prior = Normal(0.0, 1.0).log_prob(z).sum(1)  # type: ignore[no-untyped-call]
    log_q = Normal(posterior.mean, torch.exp(0.5 * posterior.log_variance)).log_prob(z).sum(1)  # type: ignore[no-untyped-call]
    q = log_q.exp() * cell
    assert q.sum() == pytest.approx(1.0, abs=1e-6)
    # The terms depend on z: a bound that left one out would be told.
    assert terms.joint(kind).std() > 1.0

    log_likelihood = float(torch.logsumexp(terms.joint(kind) + log_prior + math.log(cell), 0))
    expected = Terms(*((q * term).sum()[None] for term in (terms.image, terms.condition, terms.place)))
    lower = float(bound(kind, expected, posterior.kl(), Weights())[0])
    assert lower < log_likelihood
    log_exact_posterior = terms.joint(kind) + log_prior - log_likelihood
    divergence = float((q * (log_q - log_exact_posterior)).sum())
    assert log_likelihood - lower == pytest.approx(divergence, abs=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_bound_is_tight_when_q_is_the_exact_posterior(kind: str) -> None:
    """Linear decoder with orthogonal columns: the exact posterior is a diagonal Gaussian."""
    normal = torch.randn(6, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    decode = torch.linalg.qr(normal)[0] * torch.tensor([1.5, 0.4], dtype=torch.float64)
    offset = torch.linspace(-1, 1, 6, dtype=torch.float64)
    image = torch.tensor([0.3, -0.2, 1.0, 0.5, -0.7, 0.1], dtype=torch.float64)
    sigma = 0.6
    # Labels that do not depend on z leave the posterior as it is.
    condition, place = torch.tensor([[0.25], [0.1]], dtype=torch.float64).log()
    # Gauss-Hermite nodes integrate a quadratic under q exactly.
    nodes, node_weights = (torch.from_numpy(part) for part in np.polynomial.hermite_e.hermegauss(4))
    noise = torch.cartesian_prod(nodes, nodes)
    share = torch.cartesian_prod(node_weights, node_weights).prod(1) / (2 * math.pi)

    def bound_under(q: Posterior) -> float:
        decoded = (q.sample(noise) @ decode.T + offset).view(-1, 1, 2, 3)
        images = image.view(1, 1, 2, 3).expand_as(decoded)
        log_sigma = torch.tensor(math.log(sigma), dtype=torch.float64)
        expected = (share * gaussian_log_likelihood(images, decoded, log_sigma)).sum()
        return float(bound(kind, Terms(expected[None], condition, place), q.kl(), Weights())[0])

    covariance = decode @ decode.T + sigma**2 * torch.eye(6, dtype=torch.float64)
    exact = float(MultivariateNormal(offset, covariance).log_prob(image))  # type: ignore[no-untyped-call]
    exact += {"vae": 0.0, "c-vae": math.log(0.25), "cp-vae": math.log(0.25 * 0.1)}[kind]
    precision = 1.0 + decode.square().sum(0) / sigma**2
    mean = ((image - offset) @ decode) / sigma**2 / precision
    log_variance = -precision.log()
    assert bound_under(Posterior(mean[None], log_variance[None])) == pytest.approx(exact, abs=1e-9)
    assert bound_under(Posterior(mean[None] + 0.1, log_variance[None])) < exact - 1e-3
    assert bound_under(Posterior(mean[None], 0.5 * log_variance[None])) < exact - 1e-3


def test_each_weight_multiplies_its_term() -> None:
    image, place, condition, kl_place, kl_condition = (torch.tensor([value]) for value in (-7.0, -5.0, -3.0, 2.0, 1.5))
    weights = Weights(image=2, condition=10, place=100, beta_place=3, beta_condition=4)
    assert vae_bound(image, kl_place, kl_condition, weights).item() == -14 - 6 - 6
    assert c_vae_bound(image, condition, kl_place, kl_condition, weights).item() == -26 - 30
    assert cp_vae_bound(image, place, condition, kl_place, kl_condition, weights).item() == -56 - 500


def test_without_label_weights_the_bounds_fall_back_to_eq_1() -> None:
    terms = [torch.randn(4, generator=torch.Generator().manual_seed(seed)) for seed in range(5)]
    image, place, condition, kl_place, kl_condition = terms
    silent = Weights(condition=0, place=0, beta_place=2, beta_condition=0.5)
    expected = vae_bound(image, kl_place, kl_condition, silent)
    assert torch.equal(c_vae_bound(image, condition, kl_place, kl_condition, silent), expected)
    assert torch.equal(cp_vae_bound(image, place, condition, kl_place, kl_condition, silent), expected)


def test_gaussian_log_likelihood_sums_over_pixels() -> None:
    generator = torch.Generator().manual_seed(4)
    images, reconstruction = torch.rand(2, 3, 2, 5, 4, generator=generator)
    log_sigma = torch.tensor(-0.7)
    expected = Normal(reconstruction, log_sigma.exp()).log_prob(images).sum(dim=(1, 2, 3))  # type: ignore[no-untyped-call]
    torch.testing.assert_close(gaussian_log_likelihood(images, reconstruction, log_sigma), expected)


@pytest.mark.parametrize("error", [1e-9, 1e-4, 0.01, 0.3, 5.0])
def test_optimal_log_sigma_maximises_the_likelihood_above_the_floor(error: float) -> None:
    generator = torch.Generator().manual_seed(6)
    images = torch.rand(4, 1, 8, 8, generator=generator, dtype=torch.float64)
    reconstruction = images + error * torch.randn(4, 1, 8, 8, generator=generator, dtype=torch.float64)

    def loss(log_sigma: float) -> float:
        return -float(gaussian_log_likelihood(images, reconstruction, torch.tensor(log_sigma).double()).sum())

    best = float(minimize_scalar(loss, bounds=(-25, 5), method="bounded", options={"xatol": 1e-6}).x)
    found = float(optimal_log_sigma(images, reconstruction))
    # The soft clip lies above the larger of the two, most where they meet, and by less than 3 % for usual errors.
    assert found > max(best, LOG_SIGMA_FLOOR) - 1e-3
    assert found == pytest.approx(np.logaddexp(best, LOG_SIGMA_FLOOR), abs=1e-3)
    assert float(soft_clipped_log_sigma((images - reconstruction).square().mean())) == found
    if error >= 0.01:
        assert found == pytest.approx(best, abs=0.25 if error == 0.01 else 0.01)


def test_a_perfect_reconstruction_has_a_finite_likelihood_and_gradient() -> None:
    images = torch.rand(2, 1, 4, 4, generator=torch.Generator().manual_seed(1))
    reconstruction = images.clone().requires_grad_()
    log_sigma = optimal_log_sigma(images, reconstruction)
    likelihood = gaussian_log_likelihood(images, reconstruction, log_sigma).sum()
    (gradient,) = torch.autograd.grad(likelihood, reconstruction)
    assert log_sigma.item() == pytest.approx(LOG_SIGMA_FLOOR, abs=1e-3)
    assert torch.isfinite(likelihood)
    assert torch.isfinite(gradient).all()


def test_label_log_likelihood_by_hand() -> None:
    logits = torch.tensor([[0.0, math.log(3.0)], [math.log(4.0), 0.0]])
    found = label_log_likelihood(logits, torch.tensor([1, 1]))
    torch.testing.assert_close(found, torch.tensor([math.log(0.75), math.log(0.2)]))
    soft = label_log_likelihood(logits, torch.tensor([[0.5, 0.5], [0.0, 1.0]]))
    torch.testing.assert_close(soft, torch.tensor([0.5 * math.log(0.25 * 0.75), math.log(0.2)]))


def test_soft_targets_sum_to_one_and_peak_at_the_place() -> None:
    places = torch.tensor([0, 3, 9])
    targets = soft_place_targets(places, count=10, spread=1.5)
    torch.testing.assert_close(targets.sum(1), torch.ones(3))
    assert torch.equal(targets.argmax(1), places)
    # A Gaussian: one and three places away.
    assert (targets[1, 4] / targets[1, 3]).item() == pytest.approx(math.exp(-0.5 / 1.5**2))
    assert (targets[1, 0] / targets[1, 3]).item() == pytest.approx(math.exp(-4.5 / 1.5**2))
    assert targets[1, 2] == targets[1, 4]


def test_narrow_soft_targets_are_the_class_itself() -> None:
    places = torch.tensor([2, 0])
    targets = soft_place_targets(places, count=4, spread=0.01)
    assert torch.equal(targets, functional.one_hot(places, 4).float())
