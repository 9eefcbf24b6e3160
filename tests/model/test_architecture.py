"""The network's shapes (Table 1 and other sizes), its heads' view of the latent, and where gradients go."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor, nn

from everplace.model.architecture import (
    Encoder,
    InstanceBatchNorm2d,
    feature_map,
    hidden_widths,
    strides,
)
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import MODEL_KINDS, ModelConfig, ModelKind

CONDITIONS = ("summer", "winter")


def small_config(kind: ModelKind) -> ModelConfig:
    return ModelConfig(
        kind=kind,
        height=32,
        width=32,
        channels=1,
        conditions=() if kind == "vae" else CONDITIONS,
        places=5 if kind == "cp-vae" else 0,
    )


def small_model(kind: ModelKind) -> ConditionVAE:
    with torch.random.fork_rng():
        torch.manual_seed(3)
        return ConditionVAE(small_config(kind))


def small_batch(frames: int = 4) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(5)
    return torch.rand(frames, 1, 32, 32, generator=generator), torch.randn(frames, 128, generator=generator)


def shapes_of(layers: list[nn.Module], network: nn.Module, inputs: Tensor) -> list[tuple[int, ...]]:
    """Output shapes of the layers, without the batch, when the network is applied."""
    shapes: list[tuple[int, ...]] = []
    hooks = [layer.register_forward_hook(lambda _, __, out: shapes.append(tuple(out.shape[1:]))) for layer in layers]
    network(inputs)
    for hook in hooks:
        hook.remove()
    return shapes


def test_encoder_is_table_1_layer_by_layer() -> None:
    with torch.device("meta"):
        encoder = Encoder(ModelConfig(kind="vae")).eval()
        assert encoder.z_log_variance is not None
        layers: list[nn.Module] = [
            *encoder.convolutions,
            *encoder.fully_connected,
            encoder.z_mean,
            encoder.z_log_variance,
        ]
        # The last two run in the other order inside forward; both have 128 values.
        shapes = shapes_of(layers, encoder, torch.empty(1, 3, 224, 224))
    assert shapes == [
        (32, 112, 112),
        (64, 56, 56),
        (64, 28, 28),
        (128, 14, 14),
        (128, 7, 7),
        (4096,),
        (2048,),
        (1024,),
        (512,),
        (128,),
        (128,),
    ]
    first = encoder.fully_connected[0]
    assert isinstance(first, nn.Sequential)
    assert isinstance(first[0], nn.Linear)
    assert first[0].in_features == 6272


def test_decoder_mirrors_table_1() -> None:
    with torch.device("meta"):
        model = ConditionVAE(ModelConfig(kind="vae")).eval()
        decoder = model.decoder
        layers: list[nn.Module] = [*decoder.fully_connected, *decoder.convolutions, decoder.output]
        shapes = shapes_of(layers, decoder, torch.empty(1, 128))
    assert shapes == [
        (512,),
        (1024,),
        (2048,),
        (4096,),
        (6272,),
        (128, 14, 14),
        (64, 28, 28),
        (64, 56, 56),
        (32, 112, 112),
        (3, 224, 224),
    ]


def test_a_32_by_64_image_keeps_a_4_by_8_map_and_starts_the_chain_at_2048() -> None:
    assert feature_map(32, 64) == (3, 4, 8)
    assert hidden_widths(128 * 4 * 8) == (2048, 1024, 512)
    with torch.device("meta"):
        encoder = Encoder(ModelConfig(kind="vae", height=32, width=64, channels=1)).eval()
        shapes = shapes_of([*encoder.convolutions, *encoder.fully_connected], encoder, torch.empty(1, 1, 32, 64))
    assert shapes == [
        (32, 16, 32),
        (64, 16, 32),
        (64, 8, 16),
        (128, 8, 16),
        (128, 4, 8),
        (2048,),
        (1024,),
        (512,),
    ]


@pytest.mark.parametrize(
    ("size", "expected"),
    [((32, 64), (2, 1, 2, 1, 2)), ((64, 64), (2, 1, 2, 2, 2)), ((128, 256), (2, 2, 2, 2, 2))],
)
def test_layers_at_full_size_stand_between_the_halvings(size: tuple[int, int], expected: tuple[int, ...]) -> None:
    assert strides(*size) == expected


def test_half_of_the_channels_forget_brightness_and_contrast_and_half_keep_them() -> None:
    layer = InstanceBatchNorm2d(6).eval()
    images = torch.rand(4, 6, 8, 8, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        plain, changed = layer(images), layer(0.5 * images + 0.3)
    torch.testing.assert_close(changed[:, :3], plain[:, :3], atol=1e-3, rtol=0.0)
    assert (changed[:, 3:] - plain[:, 3:]).abs().mean() > 0.1
    alone = torch.cat([layer(image[None]) for image in images])
    torch.testing.assert_close(alone, plain)


def test_the_chain_starts_from_orthogonal_matrices() -> None:
    model = small_model("vae")
    model.initialise()
    for layer in (*model.encoder.fully_connected.modules(), model.encoder.z_mean):
        if isinstance(layer, nn.Linear):
            torch.testing.assert_close(layer.weight @ layer.weight.T, torch.eye(layer.out_features), atol=1e-4, rtol=0)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("height", "width"), [(32, 32), (64, 32), (96, 160), (128, 128), (480, 640), (32, 1024)])
def test_other_sizes_and_grey_come_back_as_they_went_in(height: int, width: int, channels: int) -> None:
    config = ModelConfig.model_validate({"kind": "vae", "height": height, "width": width, "channels": channels})
    halvings, rows, columns = feature_map(height, width)
    assert min(rows, columns) >= 4
    assert halvings == 5 or min(height, width) >> (halvings + 1) < 4
    with torch.device("meta"):
        model = ConditionVAE(config).eval()
        posterior = model.encoder(torch.empty(2, channels, height, width))
        reconstruction = model.decoder(torch.empty(2, 128))
    assert posterior.mean.shape == posterior.log_variance.shape == (2, 128)
    assert reconstruction.shape == (2, channels, height, width)


@pytest.mark.parametrize("kind", MODEL_KINDS)
def test_each_kind_owns_the_heads_of_its_equation(kind: ModelKind) -> None:
    model = small_model(kind)
    output = model(*small_batch())
    names = {name.split(".")[0] for name, _ in model.named_parameters()}
    heads = {"vae": set(), "cae": set(), "c-vae": {"condition_head"}, "cp-vae": {"condition_head", "place_head"}}[kind]
    assert names == {"encoder", "decoder"} | heads
    assert (output.condition_logits is None) == (kind in ("vae", "cae"))
    assert (output.place_logits is None) == (kind != "cp-vae")
    if output.condition_logits is not None:
        assert output.condition_logits.shape == (4, 2)
    if output.place_logits is not None:
        assert output.place_logits.shape == (4, 5)


def test_a_plain_autoencoder_decodes_its_code_whatever_the_noise() -> None:
    model = small_model("cae")
    images, noise = small_batch()
    one, other = model(images, noise), model(images, torch.zeros_like(noise))
    assert torch.equal(one.reconstruction, other.reconstruction)
    assert torch.equal(one.z, one.posterior.mean)
    assert torch.equal(model.descriptor(images), one.z)
    assert one.z.shape == (4, 128)
    assert "encoder.z_log_variance.weight" not in model.state_dict()
    with pytest.raises(ValueError, match="no KL divergence"):
        one.posterior.kl()


def test_a_plain_autoencoder_is_the_vae_without_its_variance() -> None:
    vae, cae = (small_model(kind).state_dict() for kind in ("vae", "cae"))
    assert set(vae) - set(cae) == {"encoder.z_log_variance.weight", "encoder.z_log_variance.bias"}
    assert all(vae[name].shape == value.shape for name, value in cae.items())


def test_place_head_sees_only_z_p_and_condition_head_only_z_c() -> None:
    output = small_model("cp-vae")(*small_batch())
    (from_place,) = torch.autograd.grad(output.place_logits[:, 0].sum(), output.z, retain_graph=True)
    (from_condition,) = torch.autograd.grad(output.condition_logits[:, 0].sum(), output.z, retain_graph=True)
    (from_image,) = torch.autograd.grad(output.reconstruction.square().sum(), output.z)
    # z_p is the first 96 of 128 and z_c the last 32.
    assert torch.all(from_place[:, :96] != 0)
    assert torch.all(from_place[:, 96:] == 0)
    assert torch.all(from_condition[:, :96] == 0)
    assert torch.all(from_condition[:, 96:] != 0)
    assert torch.all(from_image != 0)


MODELS: dict[str, dict[str, Any]] = {
    "vae": {"kind": "vae", "conditions": ()},
    "cae": {"kind": "cae", "conditions": ()},
    "c-vae": {"kind": "c-vae"},
    "cp-vae": {"kind": "cp-vae", "places": 5},
    "a place head of positions": {"kind": "cp-vae", "places": 5, "place_term": "position"},
    "best": {"kind": "cp-vae", "places": 5, "fully_connected": False, "oriented_gradients": True},
}


def trained_a_little(name: str) -> ConditionVAE:
    """A model whose running statistics are not the initial ones."""
    common = {"height": 32, "width": 64, "channels": 1, "conditions": CONDITIONS}
    with torch.random.fork_rng():
        torch.manual_seed(4)
        model = ConditionVAE(ModelConfig.model_validate(common | MODELS[name]))
        for _ in range(3):
            model.encoder(torch.rand(8, 1, 32, 64))
    return model.eval()


def layers_that_work(model: ConditionVAE, images: Tensor) -> set[str]:
    """The parts of the encoder that take part in a descriptor."""
    worked: set[str] = set()
    for name, part in model.encoder.named_children():
        for layer in part if isinstance(part, nn.ModuleList) else [part]:
            layer.register_forward_hook(lambda *_, name=name: worked.add(name))
    model.descriptor(images)
    return worked


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("frames", [1, 9])
def test_the_descriptor_is_the_encoders_mean_to_the_bit(name: str, frames: int) -> None:
    model, images = trained_a_little(name), torch.rand(frames, 1, 32, 64, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        descriptor, mean = model.descriptor(images), model.encoder(images).mean
    size = 128 if name in ("vae", "cae") else 96
    assert descriptor.shape == (frames, size)
    assert descriptor.std(0 if frames > 1 else 1).max() > 0.01
    assert torch.equal(descriptor, mean[:, :size])


@pytest.mark.parametrize("name", MODELS)
def test_describing_computes_nothing_that_only_the_variance_or_z_c_needs(name: str) -> None:
    read_off = {"convolutions", "fully_connected", "z_mean"}
    needed = {"gradients", "place_projection"} if name == "best" else read_off
    assert layers_that_work(trained_a_little(name), torch.rand(2, 1, 32, 64)) == needed


def test_descriptors_are_float32_under_autocast() -> None:
    for name in MODELS:
        with torch.autocast("cpu", dtype=torch.bfloat16):
            assert trained_a_little(name).descriptor(torch.rand(2, 1, 32, 64)).dtype == torch.float32


def test_sample_is_the_mean_when_the_noise_is_zero() -> None:
    model = small_model("vae").eval()
    images, noise = small_batch()
    with torch.no_grad():
        output = model(images, torch.zeros_like(noise))
        assert torch.equal(output.z, output.posterior.mean)
        assert torch.equal(output.reconstruction, model.decoder(output.posterior.mean))


def test_posterior_and_reconstruction_are_float32_under_autocast() -> None:
    model = small_model("cp-vae")
    images, noise = small_batch(2)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        output = model(images, noise)
    assert output.condition_logits is not None
    assert output.place_logits is not None
    for tensor in (
        output.posterior.mean,
        output.posterior.log_variance,
        output.reconstruction,
        output.condition_logits,
        output.place_logits,
    ):
        assert tensor.dtype == torch.float32


def test_log_variance_stays_finite_for_wild_inputs() -> None:
    model = small_model("vae").eval()
    with torch.no_grad():
        posterior = model.encoder(torch.full((2, 1, 32, 32), 1e6))
    assert torch.all(posterior.log_variance.abs() <= 10)
    assert torch.isfinite(posterior.log_variance.exp()).all()


def test_log_sigma_travels_with_the_weights_and_is_not_trained() -> None:
    model = small_model("vae")
    assert "log_sigma" in model.state_dict()
    assert "log_sigma" not in dict(model.named_parameters())
