"""Describing with a trained model: the posterior mean of z_p, opened from a run directory."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch

from everplace.describe.runs.trained import TrainedDescriber, open_method
from everplace.errors import CheckpointError
from everplace.images.decoding import ImageSpec
from everplace.model.checkpoint import Checkpoint, save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig, ModelKind
from everplace.model.pixels import to_input


def saved_run(run: Path, kind: ModelKind, channels: int = 1) -> ConditionVAE:
    """A run directory with an untrained model."""
    config = ModelConfig.model_validate(
        {
            "kind": kind,
            "height": 32,
            "width": 64,
            "channels": channels,
            "conditions": () if kind in ("vae", "cae") else ("a", "b"),
            "places": 4 if kind == "cp-vae" else 0,
            "fully_connected": False,  # 90 MB at this size
        }
    )
    with torch.random.fork_rng():
        torch.manual_seed(2)
        model = ConditionVAE(config)
    save_checkpoint(run, model, {"recipe": "faithful", "seed": 3, "epoch": 9, "value": 0.5, "notes": ["a"]})
    return model.eval()


def batch(frames: int, channels: int = 1) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return np.random.default_rng(0).integers(0, 256, (frames, 32, 64, channels), dtype=np.uint8)


@pytest.mark.parametrize("height", [32, 224])
def test_one_frame_of_oriented_gradients_is_described_in_one_thread_as_in_two(
    monkeypatch: pytest.MonkeyPatch, height: int
) -> None:
    values = {"kind": "cp-vae", "height": height, "width": 224, "conditions": ("a", "b"), "places": 4}
    config = ModelConfig.model_validate({**values, "fully_connected": False, "oriented_gradients": True})
    model = ConditionVAE(config).eval()
    describer = TrainedDescriber(Checkpoint(model), device="cpu")
    frame = np.random.default_rng(0).integers(0, 256, (1, height, 224, 3), dtype=np.uint8)
    seen: list[int] = []
    describe = model.descriptor

    def noted(images: torch.Tensor) -> torch.Tensor:
        seen.append(torch.get_num_threads())
        return describe(images)

    monkeypatch.setattr(model, "descriptor", noted)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with torch.inference_mode():
            by_two = describe(to_input(torch.from_numpy(frame))).numpy()
        by_one = describer.describe_batch(frame)
        describer.describe_batch(frame.repeat(2, axis=0))
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
    assert seen == [1, 2]
    np.testing.assert_array_equal(by_one, by_two)


@pytest.mark.parametrize("kind", ["vae", "c-vae", "cp-vae"])
def test_the_descriptor_is_the_posterior_mean_of_the_block(tmp_path: Path, kind: ModelKind) -> None:
    model = saved_run(tmp_path, kind)
    describer = open_method(str(tmp_path))
    size = 128 if kind == "vae" else 96
    assert (describer.method, describer.dimension, describer.metric) == (kind, size, "cosine")
    images = batch(5)
    values = describer.describe_batch(images)
    with torch.no_grad():
        posterior = model.encoder(to_input(torch.from_numpy(images)))
    # Another device adds up in another order.
    rounding = 1e-5 if torch.cuda.is_available() else 1e-6
    np.testing.assert_allclose(values, posterior.mean[:, :size].numpy(), atol=rounding)
    assert values.dtype == np.float32
    assert describer.latent_model is not None


def test_an_autoencoder_has_no_latent_to_audit(tmp_path: Path) -> None:
    model = saved_run(tmp_path, "cae")
    describer = open_method(str(tmp_path))
    assert (describer.method, describer.dimension, describer.metric) == ("cae", 128, "cosine")
    assert describer.latent_model is None
    images = batch(2)
    with torch.no_grad():
        code = model.encoder(to_input(torch.from_numpy(images))).mean.numpy()
    np.testing.assert_allclose(describer.describe_batch(images), code, atol=1e-5)


def test_each_row_depends_on_its_own_image_alone(tmp_path: Path) -> None:
    saved_run(tmp_path, "cp-vae")
    describer = open_method(str(tmp_path))
    images = batch(4)
    before = images.copy()
    together = describer.describe_batch(images)
    for index in range(4):
        np.testing.assert_allclose(describer.describe_batch(images[index : index + 1])[0], together[index], atol=1e-6)
    assert np.array_equal(images, before)


@pytest.mark.parametrize(("channels", "grey"), [(1, True), (3, False)])
def test_the_image_is_the_one_that_was_trained_on(tmp_path: Path, channels: int, grey: bool) -> None:
    saved_run(tmp_path, "vae", channels)
    describer = open_method(str(tmp_path))
    assert describer.image == ImageSpec((32, 64), grey=grey)
    assert describer.describe_batch(batch(2, channels)).shape == (2, 128)


def test_settings_tell_models_apart_and_are_plain_values(tmp_path: Path) -> None:
    saved_run(tmp_path, "cp-vae")
    (weights,) = tmp_path.glob("*.safetensors")
    assert open_method(str(tmp_path)).settings() == {
        "height": 32, "width": 64, "channels": 1, "recipe": "faithful", "seed": 3, "epoch": 9, "value": 0.5,
        "weights": hashlib.sha256(weights.read_bytes()).hexdigest()[:16],
    }  # fmt: skip


def test_a_model_that_is_being_trained_is_described_with_as_it_is_and_trained_on(tmp_path: Path) -> None:
    model = saved_run(tmp_path, "vae")
    wanted = TrainedDescriber(Checkpoint(model), device="cpu").describe_batch(batch(3))
    model.train()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    np.testing.assert_array_equal(TrainedDescriber(Checkpoint(model), device="cpu").describe_batch(batch(3)), wanted)
    assert model.training
    assert all(torch.equal(value, before[name]) for name, value in model.state_dict().items())


def test_a_directory_without_a_checkpoint_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"checkpoint\.json is missing"):
        open_method(str(tmp_path))


def test_a_describer_on_another_device_leaves_the_model_where_it_is(tmp_path: Path) -> None:
    model = saved_run(tmp_path, "cp-vae")
    describer = TrainedDescriber(Checkpoint(model), device="meta")
    assert {parameter.device.type for parameter in model.parameters()} == {"cpu"}
    assert describer.latent_model is not None
    assert {parameter.device.type for parameter in describer.latent_model.parameters()} == {"meta"}
