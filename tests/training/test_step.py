"""One step: the right equation, gradients everywhere, and noise that can be repeated."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

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
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch
from everplace.training.schedule import kl_warm_up
from everplace.training.step import BoundStep, bound_terms, step_noise

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


def loss_of(model: ConditionVAE, config: TrainConfig, batch: Batch, step: int = 0) -> torch.Tensor:
    """The loss of a step of an epoch of two."""
    weights = kl_warm_up(config, (step + 1) / 2)
    loss: torch.Tensor = BoundStep(model, config.seed, config.place_spread)(batch, step, weights)[0]
    return loss


def small_batch(frames: int = 6) -> Batch:
    images = torch.randint(0, 256, (frames, 32, 32, 1), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))
    return Batch(images, torch.arange(frames) % 2, torch.arange(frames) % PLACES)


@pytest.mark.parametrize("kind", MODEL_KINDS)
def test_the_gradient_of_a_step_reaches_every_parameter(kind: ModelKind, make_config: MakeConfig) -> None:
    model = small_model(kind)
    torch.autograd.backward(loss_of(model, make_config(model=kind), small_batch()))
    for name, parameter in model.named_parameters():
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
    terms = bound_terms(model, images, output, log_sigma, conditions, places, weights)

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


def test_the_plain_autoencoder_minimises_the_squared_error_alone() -> None:
    batch = small_batch()
    with torch.no_grad():
        loss, means, _ = BoundStep(small_model("cae"), 0)(batch, 0, Weights(image=9.0))
        images = to_input(batch.images)
        expected = torch.nn.functional.mse_loss(small_model("cae")(images, torch.zeros(6, 128)).reconstruction, images)
    torch.testing.assert_close(loss, expected)
    assert set(means) == {"bound", "square"}
    assert float(means["bound"]) == pytest.approx(-float(expected) * 32 * 32, rel=1e-5)


def test_held_out_frames_have_no_place_term() -> None:
    model = small_model("cp-vae")
    images = torch.rand(4, 1, 32, 32)
    output = model(images, torch.zeros(4, 128))
    terms = bound_terms(model, images, output, model.log_sigma, torch.zeros(4, dtype=torch.long), None, Weights())
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
        loss = loss_of(model, make_config(model=kind, weights={"condition": 0.0}), small_batch())
        torch.autograd.backward(loss)
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
        loss = loss_of(small_model("cp-vae"), make_config(place_spread=spread, weights=weights), batch)
        output = small_model("cp-vae")(to_input(batch.images), step_noise(0, 0, 6, 128))
    target = soft_place_targets(batch.places, PLACES, spread) if spread else batch.places
    expected = -label_log_likelihood(output.place_logits, target).mean() / (32 * 32)
    torch.testing.assert_close(loss, expected)


def test_the_position_takes_the_part_of_the_classes(make_config: MakeConfig) -> None:
    model = small_model("cp-vae", place_term="position")
    head = model.place_head
    assert isinstance(head, PositionHead)
    positions = head.positions.clone()
    torch.autograd.backward(loss_of(model, make_config(place_term="position"), small_batch()))
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
        for step in (0, 1):
            # Two steps an epoch, so the warm-up of two epochs has reached 1/4 and 2/4.
            config = make_config(warmup_epochs=2.0, weights=weights)
            losses.append(float(loss_of(small_model("cp-vae"), config, small_batch(), step)))
        whole = float(loss_of(small_model("cp-vae"), make_config(warmup_epochs=0.0, weights=weights), small_batch()))
    # The noise of the two steps differs, the KL does not depend on it.
    assert losses == pytest.approx([0.25 * whole, 0.5 * whole], rel=1e-5)
    assert whole > 0


@pytest.mark.parametrize("world", [2, 3])
def test_devices_share_out_the_noise_of_a_batch(world: int) -> None:
    """Each sample is that of the same frame in the whole batch; batch normalisation is held to make them comparable."""
    model, batch = small_model("cp-vae").eval(), small_batch()
    sampled: list[torch.Tensor] = []
    hook = model.decoder.register_forward_pre_hook(lambda _, inputs: sampled.append(inputs[0].detach()))
    BoundStep(model, 3)(batch, 5, Weights())
    for rank in range(world):
        part = Batch(*(labels[rank::world] for labels in batch))
        BoundStep(model, 3, rank=rank, world=world)(part, 5, Weights())
    hook.remove()
    whole, *parts = sampled
    for rank, part_of in enumerate(parts):
        torch.testing.assert_close(part_of, whole[rank::world])


def test_what_is_logged_are_means_over_the_frames() -> None:
    model, batch = small_model("cp-vae"), small_batch()
    with torch.no_grad():
        loss, means, z_p = BoundStep(model, 0)(batch, 0, Weights())
        model = small_model("cp-vae")
        output = model(to_input(batch.images), step_noise(0, 0, 6, 128))
    kl = output.posterior.kl()
    assert float(loss) == pytest.approx(-float(means["bound"]) / (32 * 32), rel=1e-6)
    torch.testing.assert_close(means["kl_dimensions"], kl.mean(0))
    torch.testing.assert_close(means["kl_place"], kl[:, :96].sum(1).mean())
    torch.testing.assert_close(means["kl_condition"], kl[:, 96:].sum(1).mean())
    torch.testing.assert_close(means["square"], (to_input(batch.images) - output.reconstruction).square().mean())
    torch.testing.assert_close(z_p, output.posterior.mean[:, :96])
