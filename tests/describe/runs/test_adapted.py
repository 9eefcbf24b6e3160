"""Adapted descriptors on disk: what is read gives what was written, and damage is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber, open_method, write_adapted
from everplace.errors import CheckpointError, EverplaceError
from everplace.match.similarity import similarity
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.tensor_file import save_tensors

SETTINGS: dict[str, str | int | float | bool] = {"map": "summer", "places": 7, "prior_weight": 0.5, "self_taught": True}


def projection(dimensions: int, features: int, seed: int = 0) -> Projection:
    rng = np.random.default_rng(seed)
    return Projection(rng.normal(size=(dimensions, features)), rng.normal(size=dimensions))


def written(out: Path, method: str = "hog16", seed: int = 0, dimensions: int = 5) -> AdaptedDescriber:
    base = open_describer(method)
    out.mkdir(exist_ok=True)
    made, seen = projection(dimensions, base.dimension, seed), frozenset({"b", "a"})
    write_adapted(out, method, made, SETTINGS, seen, base.dimension)
    return AdaptedDescriber(base, made, SETTINGS, seen)


def pictures(describer: Describer, count: int = 3) -> NDArray[np.uint8]:
    height, width = describer.image.size or (8, 8)
    channels = 1 if describer.image.grey else 3
    return np.random.default_rng(1).integers(0, 256, (count, height, width, channels), dtype=np.uint8)


def trained_run(run: Path) -> Path:
    config = ModelConfig.model_validate(
        {"kind": "vae", "height": 32, "width": 64, "channels": 1, "conditions": (), "fully_connected": False}
    )
    with torch.random.fork_rng():
        torch.manual_seed(3)
        save_checkpoint(run, ConditionVAE(config), {"seed": 3})
    (run / "config.toml").write_text('model = "vae"\n')
    (run / "resume").mkdir()
    (run / "resume" / "large").write_bytes(b"x")
    return run


def test_what_is_read_describes_as_what_was_written(tmp_path: Path) -> None:
    before = written(tmp_path / "run")
    after = open_describer(tmp_path / "run")
    images = pictures(before)
    np.testing.assert_array_equal(after.describe_batch(images), before.describe_batch(images))
    assert (after.method, after.dimension, after.image) == ("adapted hog16", 5, before.image)
    assert after.seen_stems == {"a", "b"}
    assert after.settings() == before.settings()
    assert after.settings().items() >= {**SETTINGS, "base.cell": 8, "base.directions": 16}.items()


def test_the_numbers_are_an_affine_map_of_the_methods() -> None:
    base, made = open_describer("hog16"), projection(4, 2048)
    images = pictures(base)
    found = AdaptedDescriber(base, made, {}).describe_batch(images)
    wanted = base.describe_batch(images).astype(float) @ made.weight.T + made.bias
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-3)


def test_descriptors_of_another_adaptation_are_not_compared(tmp_path: Path) -> None:
    first, second = written(tmp_path / "one", seed=1), written(tmp_path / "two", seed=2)
    images = list(pictures(first))
    similarity(first.describe(images), open_describer(tmp_path / "one").describe(images))
    with pytest.raises(EverplaceError, match="adapter"):
        similarity(first.describe(images), second.describe(images))


def test_a_run_that_was_adapted_is_copied(tmp_path: Path) -> None:
    run = trained_run(tmp_path / "vae")
    before = written(tmp_path / "run", str(run))
    shutil.rmtree(run)
    after = open_describer(tmp_path / "run")
    images = pictures(before)
    np.testing.assert_allclose(after.describe_batch(images), before.describe_batch(images), atol=1e-5)
    assert after.method == "adapted vae"
    assert not (tmp_path / "run" / "base" / "resume").exists()


def test_an_adapted_run_is_adapted_again(tmp_path: Path) -> None:
    written(tmp_path / "once", dimensions=9)
    before = written(tmp_path / "twice", str(tmp_path / "once"), dimensions=3)
    shutil.rmtree(tmp_path / "once")
    after = open_describer(tmp_path / "twice")
    np.testing.assert_array_equal(after.describe_batch(pictures(before)), before.describe_batch(pictures(before)))
    assert (after.method, after.dimension) == ("adapted adapted hog16", 3)


def test_a_run_inside_the_run_that_was_adapted(tmp_path: Path) -> None:
    run = trained_run(tmp_path / "vae")
    (run / ".adapted.1-2.part").mkdir()
    written(run / ".adapted.1-2.part", str(run))
    assert not (run / ".adapted.1-2.part" / "base" / ".adapted.1-2.part").exists()


def test_a_directory_that_is_called_like_the_method_is_not_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hog16").mkdir()
    (tmp_path / "hog16" / "a.png").write_bytes(b"")
    written(tmp_path / "run")
    assert open_describer(tmp_path / "run").method == "adapted hog16"
    assert not (tmp_path / "run" / "base").exists()


def test_joined_methods_are_adapted_side_by_side(tmp_path: Path) -> None:
    before = written(tmp_path / "run", "hog16+hog")
    after = open_describer(tmp_path / "run")
    images = pictures(before)
    np.testing.assert_array_equal(after.describe_batch(images), before.describe_batch(images))


def rewrite(**changed: Any) -> Callable[[Path], None]:
    """The JSON with other values; None takes one away."""

    def do(run: Path) -> None:
        about = {**json.loads((run / "checkpoint.json").read_text()), **changed}
        (run / "checkpoint.json").write_text(json.dumps({k: v for k, v in about.items() if v is not None}))

    return do


def other_tensors(**tensors: torch.Tensor) -> Callable[[Path], None]:
    def do(run: Path) -> None:
        about = json.loads((run / "checkpoint.json").read_text())
        save_tensors(run, "checkpoint", tensors, {k: v for k, v in about.items() if k != "tensors"})

    return do


def flip(run: Path) -> None:
    (path,) = run.glob("*.safetensors")
    data = bytearray(path.read_bytes())
    data[-2] ^= 64
    path.write_bytes(data)


W, B = torch.zeros(5, 2048), torch.zeros(5)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (flip, "is not the file that checkpoint.json describes"),
        (lambda run: next(run.glob("*.safetensors")).unlink(), "cannot be read"),
        (lambda run: (run / "checkpoint.json").write_text("{"), "cannot be read as JSON"),
        (rewrite(format=9), "has format 9"),
        (rewrite(method=None), "is damaged; restore it, or adapt again"),
        (rewrite(features=None), "is damaged; restore it, or adapt again"),
        (rewrite(seen_stems=None), "is damaged; restore it, or adapt again"),
        (rewrite(seen_stems=3), "is damaged; restore it, or adapt again"),
        (rewrite(settings=[1]), "is damaged; restore it, or adapt again"),
        (rewrite(method=7), "is damaged; restore it, or adapt again"),
        (rewrite(features=2047), "is damaged; restore it, or adapt again"),
        (rewrite(method="hog"), "was made for 2048 numbers, but hog gives 3780; adapt again"),
        (other_tensors(weight=W), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W, bias=B[:4]), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W[0], bias=B), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W[:, :9], bias=B), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W[:0], bias=B[:0]), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W, bias=B[:, None]), "is damaged; restore it, or adapt again"),
        (other_tensors(weight=W * torch.nan, bias=B), "holds NaN or infinity in 'weight'"),
        (other_tensors(weight=W, bias=B + torch.inf), "holds NaN or infinity in 'bias'"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, damage: Callable[[Path], None], says: str) -> None:
    written(tmp_path / "run")
    damage(tmp_path / "run")
    with pytest.raises(CheckpointError) as caught:
        open_method(str(tmp_path / "run"))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_base_that_is_gone_is_one_sentence(tmp_path: Path) -> None:
    written(tmp_path / "run", str(trained_run(tmp_path / "vae")))
    shutil.rmtree(tmp_path / "run" / "base")
    with pytest.raises(CheckpointError, match="is damaged; restore it, or adapt again"):
        open_describer(tmp_path / "run")
