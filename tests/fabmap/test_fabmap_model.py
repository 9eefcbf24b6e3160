"""FAB-MAP on disk: the same numbers afterwards, and one clear error for what does not fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from everplace.errors import CheckpointError
from everplace.fabmap.chow_liu import WordCounts, learn_tree
from everplace.fabmap.fabmap_model import FabMap, FabMapConfig, load_fabmap, save_fabmap
from everplace.fabmap.place_likelihood import observe, sampled_new_place
from everplace.tensor_file import load_tensors, save_tensors

WORDS = 8


def small_fabmap(new_place: str = "mean-field") -> FabMap:
    rng = np.random.default_rng(0)
    seen = rng.random((60, WORDS)) < 0.3
    counts = WordCounts.none(WORDS)
    counts.add(seen)
    config = FabMapConfig.model_validate({"words": WORDS, "new_place": new_place})
    vocabulary = rng.uniform(0, 255, (WORDS, 128)).astype(np.float32)
    sample = seen[: 20 if new_place == "sampled" else 0]
    return FabMap(config, vocabulary, learn_tree(counts), sample, {"seed": 4, "trained_stems": ("a", "b")})


@pytest.mark.parametrize("new_place", ["mean-field", "sampled"])
def test_round_trip_gives_the_same_numbers(tmp_path: Path, new_place: str) -> None:
    model = small_fabmap(new_place)
    save_fabmap(tmp_path, model)
    loaded = load_fabmap(tmp_path)
    words = np.random.default_rng(1).random((5, WORDS)) < 0.4
    image = np.random.default_rng(2).integers(0, 256, (64, 64), dtype=np.uint8)
    assert loaded.config == model.config
    assert np.array_equal(loaded.embed(words), model.embed(words))
    assert np.array_equal(loaded.words(image), model.words(image))
    assert loaded.words(image).any()
    assert loaded.seen_stems == {"a", "b"}
    assert len(loaded.sha256) == 64
    assert not [path for path in tmp_path.iterdir() if path.suffix not in (".json", ".safetensors")]


@pytest.mark.parametrize("new_place", ["mean-field", "sampled"])
def test_a_vector_holds_place_observation_and_new_place(new_place: str) -> None:
    model = small_fabmap(new_place)
    words = np.random.default_rng(1).random((5, WORDS)) < 0.4
    values = model.embed(words)
    observations = observe(model.tree, words)
    new = sampled_new_place(observations, model.sample) if new_place == "sampled" else observations.new_place
    assert values.shape == (5, 2 * WORDS + 1)
    assert np.array_equal(values[:, :WORDS], words)
    likelihood = values[:, WORDS : 2 * WORDS] @ values[:, :WORDS].T + observations.nowhere[:, None]
    np.testing.assert_allclose(likelihood, observations.log_likelihood(words), rtol=1e-5)
    np.testing.assert_allclose(values[:, -1] + observations.nowhere, new, rtol=1e-5)


def test_what_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"checkpoint\.json is missing"):
        load_fabmap(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"words": 1}, "describes no FAB-MAP: words"),
        ({"colour": 1}, "colour: Extra inputs"),
        ({"new_place": "magic"}, "new_place"),
        (None, "describes no FAB-MAP: model"),
        ({"words": 9}, "do not fit"),
        ({"new_place": "sampled"}, "do not fit"),
    ],
)
def test_an_altered_description_is_refused(tmp_path: Path, change: dict[str, Any] | None, message: str) -> None:
    save_fabmap(tmp_path, small_fabmap())
    path = tmp_path / "checkpoint.json"
    document = json.loads(path.read_text())
    document["model"] = None if change is None else {**document["model"], **change}
    path.write_text(json.dumps(document))
    with pytest.raises(CheckpointError, match=message):
        load_fabmap(tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("parent", torch.full((WORDS,), WORDS)),
        ("parent", torch.zeros(WORDS)),
        ("present", torch.ones(WORDS, dtype=torch.float64)),
        ("vocabulary", torch.zeros(WORDS, 64)),
        ("extra", torch.zeros(1)),
    ],
)
def test_tensors_that_cannot_be_are_refused(tmp_path: Path, name: str, value: torch.Tensor) -> None:
    save_fabmap(tmp_path, small_fabmap())
    tensors, document = load_tensors(tmp_path, "checkpoint", 1)
    save_tensors(tmp_path, "checkpoint", {**tensors, name: value}, document)
    with pytest.raises(CheckpointError, match="do not fit"):
        load_fabmap(tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("after_absent", torch.full((WORDS,), torch.nan, dtype=torch.float64)),
        ("vocabulary", torch.full((WORDS, 128), torch.inf)),
        ("present", torch.full((WORDS,), -torch.inf, dtype=torch.float64)),
    ],
)
def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, name: str, value: torch.Tensor) -> None:
    save_fabmap(tmp_path, small_fabmap())
    tensors, document = load_tensors(tmp_path, "checkpoint", 1)
    save_tensors(tmp_path, "checkpoint", {**tensors, name: value}, document)
    with pytest.raises(CheckpointError, match=f"holds NaN or infinity in '{name}'; restore it or train again"):
        load_fabmap(tmp_path)


def test_tampering_is_noticed(tmp_path: Path) -> None:
    save_fabmap(tmp_path, replace(small_fabmap()))
    (tensors,) = tmp_path.glob("*.safetensors")
    data = bytearray(tensors.read_bytes())
    data[-1] ^= 1
    tensors.write_bytes(data)
    with pytest.raises(CheckpointError, match="altered or damaged"):
        load_fabmap(tmp_path)
