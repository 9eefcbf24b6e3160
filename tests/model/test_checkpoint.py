"""A model on disk: what comes back is bit-identical, and what does not fit is one clear error."""

from __future__ import annotations

import hashlib
import json
import resource
from pathlib import Path
from typing import Any

import pytest
import torch

from everplace.errors import CheckpointError
from everplace.model.checkpoint import load_checkpoint, save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import MODEL_KINDS, ModelConfig, ModelKind
from everplace.tensor_file import load_tensors, save_tensors


def small_model(kind: ModelKind, seed: int = 0, *, fully_connected: bool = False) -> ConditionVAE:
    config = ModelConfig(
        kind=kind, height=32, width=32, channels=1, conditions=("a", "b") if kind != "vae" else (),
        places=3 if kind == "cp-vae" else 0, place_dimensions=6, condition_dimensions=2,
        fully_connected=fully_connected,
    )  # fmt: skip
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return ConditionVAE(config)


@pytest.mark.parametrize("kind", MODEL_KINDS)
def test_round_trip_gives_bit_identical_outputs(tmp_path: Path, kind: ModelKind) -> None:
    model = small_model(kind, fully_connected=True)
    images, noise = torch.rand(4, 1, 32, 32), torch.randn(4, 8)
    model(images, noise)  # moves the running statistics away from their start
    model.log_sigma.fill_(-1.25)
    save_checkpoint(tmp_path, model, {"epoch": 7, "value": 0.5})
    loaded = load_checkpoint(tmp_path)
    assert loaded.about == {"epoch": 7, "value": 0.5}
    assert loaded.model.config == model.config
    assert not loaded.model.training
    with torch.no_grad():
        before, after = model.eval()(images, noise), loaded.model(images, noise)
    assert torch.equal(before.posterior.mean, after.posterior.mean)
    if kind == "cae":
        assert before.posterior.log_variance is after.posterior.log_variance is None
    else:
        assert torch.equal(before.posterior.log_variance, after.posterior.log_variance)
    assert torch.equal(before.reconstruction, after.reconstruction)
    assert loaded.model.log_sigma == -1.25
    for one, other in ((before.condition_logits, after.condition_logits), (before.place_logits, after.place_logits)):
        assert (one is None) == (other is None)
        assert one is None or other is None or torch.equal(one, other)


def test_loading_draws_no_random_numbers_and_gives_trainable_weights(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, small_model("cp-vae"), {})
    before = torch.random.get_rng_state()
    model = load_checkpoint(str(tmp_path)).model
    assert torch.equal(torch.random.get_rng_state(), before)
    assert all(parameter.requires_grad and not parameter.is_meta for parameter in model.parameters())
    assert all(not buffer.is_meta for buffer in model.buffers())


def test_saving_leaves_the_model_as_it_is(tmp_path: Path) -> None:
    model = small_model("vae")
    save_checkpoint(tmp_path, model, {})
    assert model.training


def test_what_is_no_run_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="nowhere is not a run directory"):
        load_checkpoint(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match=r"checkpoint\.json is missing"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "magic"}, "kind"),
        ({"height": 33}, "33x32 is not a multiple of 32"),
        ({"latent": 5}, "latent: Extra inputs"),
        (None, "model"),
    ],
)
def test_a_model_that_cannot_be_is_named(tmp_path: Path, change: dict[str, Any] | None, message: str) -> None:
    save_checkpoint(tmp_path, small_model("vae"), {})
    path = tmp_path / "checkpoint.json"
    document = json.loads(path.read_text())
    document["model"] = None if change is None else {**document["model"], **change}
    path.write_text(json.dumps(document))
    with pytest.raises(CheckpointError, match=rf"checkpoint\.json describes no model: .*{message}"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"place_dimensions": 7},
        {"kind": "c-vae", "conditions": ["a", "b"]},
        {"height": 64},
        {"height": 32_000_000_000, "width": 32_000_000_000},
        {"place_dimensions": 10**15},
        {"place_dimensions": 10**30},
    ],
    ids=["latent", "head", "size", "image for no machine", "latent for no machine", "beyond 64 bits"],
)
def test_weights_that_do_not_fit_are_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    save_checkpoint(tmp_path, small_model("vae", fully_connected=True), {})
    path = tmp_path / "checkpoint.json"
    document = json.loads(path.read_text())
    document["model"].update(change)
    path.write_text(json.dumps(document))
    with pytest.raises(CheckpointError, match=f"the weights in {tmp_path} do not fit"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize("change", [{"height": 320_000}, {"width": 32_000_000}, {"width": 3_200_000, "height": 64}])
def test_an_image_of_another_size_takes_no_memory(tmp_path: Path, change: dict[str, Any]) -> None:
    config = ModelConfig(
        kind="cp-vae", height=32, width=32, conditions=("a", "b"), places=3, oriented_gradients=True,
        fully_connected=False,
    )  # fmt: skip
    save_checkpoint(tmp_path, ConditionVAE(config), {})
    assert load_checkpoint(tmp_path).model.config == config
    path = tmp_path / "checkpoint.json"
    document = json.loads(path.read_text())
    document["model"].update(change)
    path.write_text(json.dumps(document))
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**28, hard))
    try:
        with pytest.raises(CheckpointError, match=f"the weights in {tmp_path} do not fit"):
            load_checkpoint(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
@pytest.mark.parametrize("key", ["log_sigma", "encoder.z_mean.weight", "decoder.convolutions.0.1.running_var"])
def test_weights_that_are_not_finite_are_refused(tmp_path: Path, key: str, value: float) -> None:
    model = small_model("vae")
    model.state_dict()[key].view(-1)[-1] = value
    save_checkpoint(tmp_path, model, {})
    with pytest.raises(CheckpointError, match=f"holds NaN or infinity in '{key}'; restore it or train again"):
        load_checkpoint(tmp_path)


def test_weights_of_another_precision_are_refused(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, small_model("vae"), {})
    tensors, document = load_tensors(tmp_path, "checkpoint", 1)
    save_tensors(tmp_path, "checkpoint", {key: value.double() for key, value in tensors.items()}, document)
    with pytest.raises(CheckpointError, match="do not fit"):
        load_checkpoint(tmp_path)


def test_saving_over_an_older_model_replaces_it(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, small_model("vae", seed=1), {"epoch": 1})
    save_checkpoint(tmp_path, small_model("c-vae", seed=2), {"epoch": 2})
    loaded = load_checkpoint(tmp_path)
    assert (loaded.model.config.kind, loaded.about) == ("c-vae", {"epoch": 2})
    assert len(list(tmp_path.iterdir())) == 2


def test_what_was_seen_and_the_hash_of_the_weights_come_back(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, small_model("vae"), {"trained_stems": ("a", "b"), "held_out_stems": ("b", "d")})
    loaded = load_checkpoint(tmp_path)
    assert loaded.seen_stems == {"a", "b", "d"}
    (weights,) = tmp_path.glob("*.safetensors")
    assert loaded.sha256 == hashlib.sha256(weights.read_bytes()).hexdigest()


@pytest.mark.parametrize("about", [{}, {"trained_stems": 3, "held_out_stems": [1]}])
def test_where_nothing_was_recorded_nothing_was_seen(tmp_path: Path, about: dict[str, Any]) -> None:
    save_checkpoint(tmp_path, small_model("vae"), about)
    assert load_checkpoint(tmp_path).seen_stems == frozenset()


def test_a_number_that_json_does_not_have_is_refused(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, small_model("vae"), {"value": 0.5})
    path = tmp_path / "checkpoint.json"
    path.write_text(path.read_text().replace("0.5", "NaN"))
    with pytest.raises(CheckpointError, match="NaN is no number of JSON"):
        load_checkpoint(tmp_path)
