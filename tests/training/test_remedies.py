"""What remedies add to a step: each by an independent computation, and nothing where they are off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch

from everplace.model.bounds import Weights, optimal_log_sigma
from everplace.model.condition_vae import ConditionVAE, Output
from everplace.model.model_config import ModelConfig
from everplace.training.remedies import RemedyTerms
from everplace.training.sections import Remedies
from everplace.training.terms import bound_terms, step_noise

CONFIG = ModelConfig(
    kind="cp-vae", height=32, width=32, channels=1, conditions=("a", "b"), places=3, fully_connected=False
)
CONDITIONS, PLACES = torch.tensor([0, 1, 1, 0, 0, 1]), torch.tensor([0, 0, 1, 1, 2, 2])
LABELS = (CONDITIONS, PLACES)
IMAGES = torch.rand(6, 1, 32, 32, generator=torch.Generator().manual_seed(2))
WEIGHTS = Weights(image=0.5, condition=3.0, place=7.0, beta_place=0.25, beta_condition=2.0)


def made() -> tuple[ConditionVAE, Output]:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = ConditionVAE(CONFIG).eval()
    return model, model(IMAGES, step_noise(0, 0, 6, 128))


def measured(
    progress: float = 0.5, **remedies: Any
) -> tuple[RemedyTerms, dict[str, torch.Tensor], ConditionVAE, Output]:
    """The terms of the bound and of the remedies, with what they were made by."""
    model, output = made()
    with torch.random.fork_rng():
        torch.manual_seed(1)
        added = RemedyTerms(CONFIG, Remedies(**remedies))
    log_sigma = optimal_log_sigma(IMAGES, output.reconstruction)
    terms = bound_terms(model, IMAGES, output, log_sigma, LABELS, WEIGHTS)
    return added, terms | added(model, IMAGES, output, log_sigma, LABELS, progress), model, output


def test_without_remedies_the_objective_is_the_bound_and_nothing_is_drawn_or_learned() -> None:
    state = torch.random.get_rng_state()
    added = RemedyTerms(CONFIG, Remedies())
    assert torch.equal(torch.random.get_rng_state(), state)
    assert not added.state_dict()
    model, output = made()
    assert added(model, IMAGES, output, torch.tensor(-1.0), LABELS, 0.5) == {}
    terms = bound_terms(model, IMAGES, output, torch.tensor(-1.0), LABELS, WEIGHTS)
    assert torch.equal(added.objective(terms, WEIGHTS), terms["bound"].mean())


def test_the_adversary_reads_the_means_of_z_p_and_turns_their_gradient_alone() -> None:
    added, terms, _, output = measured(progress=0.3, adversary=40.0)
    assert added.adversary is not None
    z_p = output.posterior.mean[:, :96]
    logits = added.adversary.layers((z_p - z_p.mean(0)) / (z_p.var(0, correction=0) + 1e-5).sqrt())
    expected = torch.log_softmax(logits, dim=1)[torch.arange(6), CONDITIONS]
    torch.testing.assert_close(terms["adversary"], expected)
    objective = added.objective(terms, WEIGHTS)
    torch.testing.assert_close(objective, terms["bound"].mean() + 40.0 * expected.mean())
    parameters = list(added.parameters())
    alone = objective - terms["bound"].mean()
    gradients = torch.autograd.grad(alone, [output.posterior.mean, *parameters], retain_graph=True)
    plain = torch.autograd.grad(40.0 * expected.mean(), [output.posterior.mean, *parameters])
    torch.testing.assert_close(gradients[0], -math.tanh(1.5) * plain[0], rtol=1e-4, atol=1e-5)
    assert plain[0].abs().max() > 0
    for one, other in zip(gradients[1:], plain[1:], strict=True):
        torch.testing.assert_close(one, other)


@pytest.mark.parametrize(
    ("swap_z_c", "donors"), [("same_place", (0, 1, 2, 3, 4, 5)), ("other_place", (3, 2, 5, 4, 0, 1))]
)
def test_a_swap_decodes_the_z_p_of_the_other_frame_of_the_place(swap_z_c: str, donors: tuple[int, ...]) -> None:
    """The z_c of another place is that of the next frame in the same condition: a b b a a b."""
    added, terms, model, output = measured(swap=0.3, swap_z_c=swap_z_c)
    log_sigma = float(optimal_log_sigma(IMAGES, output.reconstruction).detach())
    expected = []
    for frame, other in ((0, 1), (1, 0), (2, 3), (3, 2), (4, 5), (5, 4)):
        assert CONDITIONS[donors[frame]] == CONDITIONS[frame]
        z = torch.cat([output.z[other, :96], output.z[donors[frame], 96:]])
        with torch.no_grad():
            error = (model.decoder(z[None])[0] - IMAGES[frame]).double().square().numpy()
        density = -0.5 * error / math.exp(2 * log_sigma) - log_sigma - 0.5 * math.log(2 * math.pi)
        expected.append(float(density.sum()))
    np.testing.assert_allclose(terms["swap"].detach().numpy(), expected, rtol=1e-5)
    objective = added.objective(terms, WEIGHTS)
    assert objective.item() == pytest.approx(terms["bound"].mean().item() + 0.3 * np.mean(expected), rel=1e-5)


@pytest.mark.parametrize(
    ("conditions", "places", "donors"),
    [
        # Two traverses share a condition: the next frame of the condition may be the other one of the place.
        ((0, 0, 0, 1, 1, 0), (0, 0, 1, 1, 2, 2), {0: 2, 1: 2, 2: 5, 3: 4, 4: 3, 5: 0}),
        # Two pairs of one place.
        ((0, 1, 0, 1, 1, 0), (0, 0, 0, 0, 1, 1), {0: 5, 1: 4, 2: 5, 3: 4, 4: 1, 5: 0}),
        # Alone in its condition, and in a condition that only its own place shows.
        ((0, 1, 1, 1, 1, 1), (0, 0, 1, 1, 2, 2), {1: 2, 2: 4, 3: 4, 4: 1, 5: 1}),
        ((0, 0, 1, 1, 2, 1), (0, 0, 1, 1, 2, 2), {2: 5, 3: 5, 5: 2}),
        ((0, 0, 1, 1, 2, 3), (0, 0, 1, 1, 2, 2), {}),
    ],
)
def test_z_c_of_another_place_is_of_another_place_in_the_condition_or_the_frame_is_left_out(
    conditions: tuple[int, ...], places: tuple[int, ...], donors: dict[int, int]
) -> None:
    model, output = made()
    added = RemedyTerms(CONFIG, Remedies(swap=1.0, swap_z_c="other_place"))
    labels = (torch.tensor(conditions), torch.tensor(places))
    found = added(model, IMAGES, output, torch.tensor(-1.0), labels, 0.5)["swap"]
    expected = [0.0]
    if donors:
        other = [1, 0, 3, 2, 5, 4]
        z = torch.stack([torch.cat([output.z[other[frame], :96], output.z[z_c, 96:]]) for frame, z_c in donors.items()])
        error = (model.decoder(z) - IMAGES[list(donors)]).square().flatten(1)
        expected = (-0.5 * error * math.exp(2.0) + 1.0 - 0.5 * math.log(2 * math.pi)).sum(1).tolist()
    np.testing.assert_allclose(found.detach().numpy(), expected, rtol=1e-5)


@pytest.mark.parametrize("swap_z_c", ["same_place", "other_place"])
def test_a_swap_is_normalised_by_its_batch_and_leaves_the_running_statistics_alone(swap_z_c: Any) -> None:
    model, output = made()
    model.decoder.train()
    before = {name: buffer.clone() for name, buffer in model.decoder.named_buffers()}
    added = RemedyTerms(CONFIG, Remedies(swap=1.0, swap_z_c=swap_z_c))
    swap = added(model, IMAGES, output, torch.tensor(-1.0), LABELS, 0.5)["swap"]
    after = dict(model.decoder.named_buffers())
    assert all(torch.equal(before[name], after[name]) for name in before)
    # By the statistics of the batch, as a decoder in training mode is.
    donors = [0, 1, 2, 3, 4, 5] if swap_z_c == "same_place" else [3, 2, 5, 4, 0, 1]
    swapped = model.decoder(torch.cat([output.z[[1, 0, 3, 2, 5, 4], :96], output.z[donors, 96:]], dim=1))
    error = (swapped - IMAGES).square().flatten(1)
    expected = (-0.5 * error * math.exp(2.0) + 1.0 - 0.5 * math.log(2 * math.pi)).sum(1)
    torch.testing.assert_close(swap, expected)
    # What follows is counted again.
    assert any(not torch.equal(before[name], after[name]) for name in before)


def test_a_swap_does_not_reward_a_worse_reconstruction() -> None:
    _, terms, _, output = measured(swap=1.0)
    (gradient,) = torch.autograd.grad(terms["swap"].sum(), output.reconstruction, allow_unused=True)
    assert gradient is None


def test_a_conditional_prior_takes_the_place_of_the_standard_one() -> None:
    added, terms, _, output = measured(conditional_prior=True)
    assert added.conditional_prior is not None
    # It starts as N(0, I), so the objective starts as the bound.
    torch.testing.assert_close(added.objective(terms, WEIGHTS), terms["bound"].mean())
    generator = torch.Generator().manual_seed(4)
    with torch.no_grad():
        for parameter in added.conditional_prior.parameters():
            parameter.copy_(torch.randn(2, 32, generator=generator))
    model, _ = made()
    terms |= added(model, IMAGES, output, torch.tensor(-1.0), LABELS, 0.5)
    assert output.posterior.log_variance is not None
    prior = torch.distributions.Normal(
        added.conditional_prior.mean[CONDITIONS], (0.5 * added.conditional_prior.log_variance[CONDITIONS]).exp()
    )
    posterior = torch.distributions.Normal(
        output.posterior.mean[:, 96:], (0.5 * output.posterior.log_variance[:, 96:]).exp()
    )
    divergence = torch.distributions.kl_divergence(posterior, prior).sum(1)
    torch.testing.assert_close(terms["kl_conditional"], divergence)
    # The bound without its divergence of z_c, and the other one instead.
    expected = (terms["bound"] + 2.0 * terms["kl_condition"] - 2.0 * divergence).mean()
    torch.testing.assert_close(added.objective(terms, WEIGHTS), expected)


@pytest.mark.parametrize("conditional_prior", [False, True])
def test_free_bits_take_the_place_of_the_divergence_of_both_blocks(conditional_prior: bool) -> None:
    # Half of the dimensions are below it.
    nats = made()[1].posterior.kl().mean(0).median().item()
    added, terms, _, output = measured(free_bits=nats, conditional_prior=conditional_prior)
    if conditional_prior:
        assert added.conditional_prior is not None
        with torch.no_grad():
            added.conditional_prior.mean.fill_(0.1)
        model, _ = made()
        terms |= added(model, IMAGES, output, torch.tensor(-1.0), LABELS, 0.5)
    assert output.posterior.log_variance is not None
    centre = torch.cat([torch.zeros(96), torch.full((32,), 0.1 if conditional_prior else 0.0)])
    kl = torch.distributions.kl_divergence(
        torch.distributions.Normal(output.posterior.mean, (0.5 * output.posterior.log_variance).exp()),
        torch.distributions.Normal(centre, torch.ones(128)),
    )
    cost = [max(nats, mean) for mean in kl.mean(0).tolist()]
    assert 20 < cost.count(nats) < 100
    rest = (terms["bound"] + 0.25 * terms["kl_place"] + 2.0 * terms["kl_condition"]).mean()
    expected = rest.item() - 0.25 * sum(cost[:96]) - 2.0 * sum(cost[96:])
    assert added.objective(terms, WEIGHTS).item() == pytest.approx(expected, rel=1e-5)
    assert min(terms["free_place"].item(), terms["free_condition"].item()) >= 0.0
