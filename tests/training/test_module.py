"""One step: the right equation, gradients everywhere, and noise that can be repeated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import lightning
import pytest
import torch

from everplace.errors import DivergedError
from everplace.model.bounds import (
    Weights,
    c_vae_bound,
    cp_vae_bound,
    gaussian_log_likelihood,
    label_log_likelihood,
    soft_place_targets,
    vae_bound,
)
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import MODEL_KINDS, ModelConfig, ModelKind, PlaceTerm
from everplace.model.pixels import to_input
from everplace.model.place_head import PositionHead
from everplace.model.posterior import Posterior
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch
from everplace.training.module import BoundModule
from everplace.training.remedies import RemedyTerms
from everplace.training.terms import bound_terms, step_noise

MakeConfig = Callable[..., TrainConfig]

PLACES = 5


def small_model(kind: ModelKind, place_term: PlaceTerm = "classes") -> ConditionVAE:
    config = ModelConfig(
        kind=kind, height=32, width=32, channels=1, conditions=("a", "b") if kind != "vae" else (),
        places=PLACES if kind == "cp-vae" else 0, place_term=place_term,
    )  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return ConditionVAE(config)


def small_module(model: ConditionVAE, config: TrainConfig) -> BoundModule:
    module = BoundModule(model, RemedyTerms(model.config, config.remedies), config, steps_per_epoch=2)
    module.trainer = lightning.Trainer(
        accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    )  # fmt: skip
    return module


def small_batch(frames: int = 6) -> Batch:
    images = torch.randint(0, 256, (frames, 32, 32, 1), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))
    return Batch(images, torch.arange(frames) % 2, torch.arange(frames) % PLACES)


@pytest.mark.parametrize("kind", MODEL_KINDS)
def test_the_gradient_of_a_step_reaches_every_parameter(kind: ModelKind, make_config: MakeConfig) -> None:
    module = small_module(small_model(kind), make_config(model=kind))
    module.training_step(small_batch(), 0).backward()  # type: ignore[no-untyped-call]
    for name, parameter in module.model.named_parameters():
        assert parameter.grad is not None, name
        assert torch.isfinite(parameter.grad).all(), name
        assert parameter.grad.abs().max() > 0, name


@pytest.mark.parametrize("kind", ["vae", "c-vae", "cp-vae"])
def test_each_kind_maximises_its_own_equation(kind: ModelKind) -> None:
    model = small_model(kind)
    images = torch.rand(4, 1, 32, 32, generator=torch.Generator().manual_seed(2))
    conditions, places = torch.tensor([0, 1, 1, 0]), torch.tensor([4, 0, 2, 2])
    log_sigma = torch.tensor(-0.3)
    weights = Weights(image=0.5, condition=3.0, place=7.0, beta_place=0.25, beta_condition=2.0)
    output = model(images, step_noise(0, 0, 4, 128))
    terms = bound_terms(model, images, output, log_sigma, (conditions, places), weights)

    kl = output.posterior.kl()
    image = gaussian_log_likelihood(images, output.reconstruction, log_sigma)
    kl_place, kl_condition = kl[:, :96].sum(1), kl[:, 96:].sum(1)
    expected = vae_bound(image, kl_place, kl_condition, weights)
    if kind != "vae":
        condition = label_log_likelihood(output.condition_logits, conditions)
        expected = c_vae_bound(image, condition, kl_place, kl_condition, weights)
        if kind == "cp-vae":
            place = label_log_likelihood(output.place_logits, places)
            expected = cp_vae_bound(image, place, condition, kl_place, kl_condition, weights)
    assert torch.equal(terms["bound"], expected)
    assert ("condition" in terms, "place" in terms) == (kind != "vae", kind == "cp-vae")


def test_the_plain_autoencoder_minimises_the_squared_error_alone(make_config: MakeConfig) -> None:
    batch = small_batch()
    module = small_module(small_model("cae"), make_config(model="cae", warmup_epochs=3.0, weights={"image": 9.0}))
    with torch.no_grad():
        loss = module.training_step(batch, 0)
        images = to_input(batch.images)
        expected = torch.nn.functional.mse_loss(small_model("cae")(images, torch.zeros(6, 128)).reconstruction, images)
    torch.testing.assert_close(loss, expected)
    row = module._sums
    assert set(row) == {"bound", "square"}
    assert float(row["bound"]) == pytest.approx(-float(expected) * 32 * 32, rel=1e-5)


def test_held_out_frames_have_no_place_term() -> None:
    model = small_model("cp-vae")
    images = torch.rand(4, 1, 32, 32)
    output = model(images, torch.zeros(4, 128))
    terms = bound_terms(model, images, output, model.log_sigma, (torch.zeros(4, dtype=torch.long), None), Weights())
    expected = c_vae_bound(terms["image"], terms["condition"], terms["kl_place"], terms["kl_condition"], Weights())
    assert "place" not in terms
    assert torch.equal(terms["bound"], expected)


def test_without_its_head_a_c_vae_is_a_vae(make_config: MakeConfig) -> None:
    plain, labelled = small_model("vae"), small_model("c-vae")
    assert set(labelled.load_state_dict(plain.state_dict(), strict=False).missing_keys) == {
        "condition_head.weight",
        "condition_head.bias",
    }
    losses, gradients = [], []
    for kind, model in (("vae", plain), ("c-vae", labelled)):
        module = small_module(model, make_config(model=kind, weights={"condition": 0.0}))
        loss = module.training_step(small_batch(), 0)
        loss.backward()  # type: ignore[no-untyped-call]
        losses.append(loss)
        gradients.append({name: parameter.grad for name, parameter in model.named_parameters()})
    assert torch.equal(losses[0], losses[1])
    for name, gradient in gradients[0].items():
        other = gradients[1][name]
        assert gradient is not None
        assert other is not None
        assert torch.equal(gradient, other), name


@pytest.mark.parametrize("spread", [0.0, 2.0])
def test_softened_place_targets_are_used_when_asked_for(make_config: MakeConfig, spread: float) -> None:
    """With all other weights 0 the loss is the place term alone."""
    weights = {"image": 0.0, "condition": 0.0, "place": 1.0, "beta_place": 0.0, "beta_condition": 0.0}
    batch = small_batch()
    with torch.no_grad():
        loss = small_module(small_model("cp-vae"), make_config(place_spread=spread, weights=weights)).training_step(
            batch, 0
        )
        output = small_model("cp-vae")(to_input(batch.images), step_noise(0, 0, 6, 128))
    target = soft_place_targets(batch.places, PLACES, spread) if spread else batch.places
    expected = -label_log_likelihood(output.place_logits, target).mean() / (32 * 32)
    torch.testing.assert_close(loss, expected)


def test_the_position_takes_the_part_of_the_classes(make_config: MakeConfig) -> None:
    model = small_model("cp-vae", place_term="position")
    module = small_module(model, make_config(place_term="position"))
    head = model.place_head
    assert isinstance(head, PositionHead)
    positions = head.positions.clone()
    torch.autograd.backward(module.training_step(small_batch(), 0))
    assert torch.equal(head.positions, positions)
    assert all(parameter.grad is not None and parameter.grad.any() for parameter in head.parameters())


def test_noise_depends_on_seed_and_step_alone() -> None:
    torch.manual_seed(1)
    first = step_noise(3, 8, 5, 4)
    state = torch.random.get_rng_state()
    assert torch.equal(step_noise(3, 8, 5, 4), first)
    assert torch.equal(torch.random.get_rng_state(), state)
    assert not torch.equal(step_noise(3, 9, 5, 4), first)
    assert not torch.equal(step_noise(4, 8, 5, 4), first)
    many = step_noise(0, 0, 50_000, 2)
    assert abs(float(many.mean())) < 0.02
    assert abs(float(many.std()) - 1.0) < 0.02


def test_kl_weights_rise_over_the_warm_up(make_config: MakeConfig) -> None:
    """With all other weights 0 the loss is the weighted KL alone: linear in what the warm-up has reached."""
    weights = {"image": 0.0, "condition": 0.0, "place": 0.0, "beta_place": 1.0, "beta_condition": 0.0}
    losses = []
    with torch.no_grad():
        for batch_index in (0, 1):
            # Two steps an epoch, so the warm-up of two epochs has reached 1/4 and 2/4.
            module = small_module(small_model("cp-vae"), make_config(warmup_epochs=2.0, weights=weights))
            losses.append(float(module.training_step(small_batch(), batch_index)))
        full = small_module(small_model("cp-vae"), make_config(warmup_epochs=0.0, weights=weights))
        whole = float(full.training_step(small_batch(), 0))
    # The noise of the two steps differs, the KL does not depend on it.
    assert losses == pytest.approx([0.25 * whole, 0.5 * whole], rel=1e-5)
    assert whole > 0


def test_poisoned_weights_stop_the_run(make_config: MakeConfig) -> None:
    module = small_module(small_model("cp-vae"), make_config())
    with torch.no_grad():
        module.model.decoder.output.weight[0] = torch.nan
    with pytest.raises(DivergedError, match="diverged in epoch 1: image is not finite; try a lower learning_rate"):
        module.training_step(small_batch(), 0)
    with pytest.raises(DivergedError, match=r"decoder\.output\.weight is not finite"):
        module.require_finite(module.model.state_dict())


@pytest.mark.parametrize("has_checkpoint", [True, False])
def test_a_checkpoint_is_spoken_of_only_where_there_is_one(make_config: MakeConfig, has_checkpoint: bool) -> None:
    module = small_module(small_model("vae"), make_config())
    module.first_epoch, module.has_checkpoint = 3, has_checkpoint
    with pytest.raises(DivergedError) as caught:
        module.require_finite({"loss": float("nan")})
    assert ("last good checkpoint stands" in str(caught.value)) is has_checkpoint


@pytest.mark.parametrize("conditional_prior", [False, True])
def test_the_active_dimensions_of_z_c_are_counted_from_the_prior_that_the_run_has(
    conditional_prior: bool, make_config: MakeConfig
) -> None:
    """A posterior that is p(z_c|c) but for three of its dimensions."""
    config = make_config(remedies={"conditional_prior": conditional_prior})
    module = small_module(small_model("cp-vae"), config)
    batch = small_batch()
    prior = torch.randn(2, 32, generator=torch.Generator().manual_seed(0)) + torch.tensor([[4.0], [-4.0]])
    if module.remedies.conditional_prior is not None:
        with torch.no_grad():
            module.remedies.conditional_prior.mean.copy_(prior)
    z_c = prior[batch.conditions]
    z_c[:, :3] += 1.0
    mean = torch.cat([torch.zeros(6, 96), z_c], dim=1)
    output = replace(
        module.model(to_input(batch.images), step_noise(0, 0, 6, 128)), posterior=Posterior(mean, 0 * mean)
    )
    module._remember({}, to_input(batch.images), output, batch.conditions)
    module.trainer.optimizers = [torch.optim.SGD(module.parameters(), lr=1.0)]
    means = module.epoch_means()
    assert (means["active_place"], means["active_condition"]) == (0, 3 if conditional_prior else 32)
