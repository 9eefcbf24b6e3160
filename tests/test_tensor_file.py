"""The pair of JSON and safetensors: whole or not at all, and nothing altered is loaded."""

from __future__ import annotations

import hashlib
import json
import resource
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from everplace import tensor_file
from everplace.errors import CheckpointError, StorageError
from everplace.regular_files import read_regular
from everplace.tensor_file import has_tensors, load_tensors, save_tensors


def tensors(value: float, size: int = 4) -> dict[str, Tensor]:
    return {"a": torch.full((size,), value), "b": torch.arange(3)}


def saved(run: Path, value: float = 1.0) -> Path:
    """Saves a pair named `pair` and returns its JSON."""
    save_tensors(run, "pair", tensors(value), {"format": 2, "note": "sommer å"})
    return run / "pair.json"


def weights_of(run: Path) -> Path:
    (path,) = run.glob("pair-*.safetensors")
    return path


def rewrite(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **changes}), "utf-8")


def test_round_trip(tmp_path: Path) -> None:
    run = tmp_path / "deep" / "run"
    assert not has_tensors(run, "pair")
    saved(run)
    assert has_tensors(run, "pair")
    loaded, document = load_tensors(run, "pair", 2)
    assert document["note"] == "sommer å"
    assert loaded.keys() == {"a", "b"}
    assert torch.equal(loaded["a"], torch.full((4,), 1.0))
    assert torch.equal(loaded["b"], torch.arange(3))


def test_saving_again_replaces_the_pair_and_leaves_nothing_else(tmp_path: Path) -> None:
    saved(tmp_path, 1.0)
    (tmp_path / "other-0123.safetensors").write_bytes(b"another name's")
    saved(tmp_path, 2.0)
    assert load_tensors(tmp_path, "pair", 2)[0]["a"][0] == 2.0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "other-0123.safetensors",
        weights_of(tmp_path).name,
        "pair.json",
    ]


def test_a_view_of_a_larger_tensor_is_saved_as_itself(tmp_path: Path) -> None:
    save_tensors(tmp_path, "pair", {"a": torch.arange(12.0).view(3, 4).T[1]}, {"format": 2})
    assert load_tensors(tmp_path, "pair", 2)[0]["a"].tolist() == [1.0, 5.0, 9.0]


@pytest.mark.parametrize("position", [0, 9, -1])
def test_one_altered_byte_is_noticed(tmp_path: Path, position: int) -> None:
    saved(tmp_path)
    path = weights_of(tmp_path)
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckpointError, match=rf"{path.name} is not the file that pair\.json describes"):
        load_tensors(tmp_path, "pair", 2)


@pytest.mark.parametrize("length", [0, 7, 100])
def test_a_truncated_file_is_noticed(tmp_path: Path, length: int) -> None:
    saved(tmp_path)
    path = weights_of(tmp_path)
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(CheckpointError, match=path.name):
        load_tensors(tmp_path, "pair", 2)


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"pair\.json is missing"):
        load_tensors(tmp_path, "pair", 2)
    saved(tmp_path)
    path = weights_of(tmp_path)
    path.unlink()
    with pytest.raises(CheckpointError, match=f"{path.name} cannot be read"):
        load_tensors(tmp_path, "pair", 2)


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b'{"format": 2', b"\xff\xfe{}", b"[" * 100_000, b'{"format": 1' + b"0" * 5000 + b"}"],
    ids=["empty", "open", "cut", "no utf-8", "deep", "huge number"],
)
def test_malformed_json_is_named(tmp_path: Path, text: bytes) -> None:
    saved(tmp_path).write_bytes(text)
    with pytest.raises(CheckpointError, match=r"pair\.json cannot be read as JSON"):
        load_tensors(tmp_path, "pair", 2)


@pytest.mark.parametrize("text", ["[]", "null", "{}", '{"format": 3}', '{"format": "2"}'])
def test_another_format_is_named(tmp_path: Path, text: str) -> None:
    saved(tmp_path).write_text(text)
    with pytest.raises(CheckpointError, match=r"pair\.json has format .* reads format 2"):
        load_tensors(tmp_path, "pair", 2)


@pytest.mark.parametrize(
    "file",
    [
        "../secret.safetensors",
        "/etc/secret.safetensors",
        "a/b.safetensors",
        "..\\x.safetensors",
        "a\0.safetensors",
        "x.safetensors\n",
        "x",
        "",
        None,
        5,
    ],
)
def test_a_tensor_file_elsewhere_is_refused(tmp_path: Path, file: object) -> None:
    run = tmp_path / "run"
    path = saved(run)
    shutil.copy(weights_of(run), tmp_path / "secret.safetensors")
    digest = json.loads(path.read_text("utf-8"))["tensors"]["sha256"]
    rewrite(path, tensors={"file": file, "sha256": digest})
    with pytest.raises(CheckpointError, match=r"pair\.json names no tensor file beside it"):
        load_tensors(run, "pair", 2)


@pytest.mark.parametrize("entry", [None, [], "pair.safetensors", {}])
def test_no_tensor_entry_is_named(tmp_path: Path, entry: object) -> None:
    path = saved(tmp_path)
    rewrite(path, tensors=entry)
    with pytest.raises(CheckpointError, match=r"pair\.json names no tensor file beside it"):
        load_tensors(tmp_path, "pair", 2)


def test_what_is_no_safetensors_file_is_named(tmp_path: Path) -> None:
    path = saved(tmp_path)
    data = b"\x80\x04pickled?"
    (tmp_path / "evil.safetensors").write_bytes(data)
    rewrite(path, tensors={"file": "evil.safetensors", "sha256": hashlib.sha256(data).hexdigest()})
    with pytest.raises(CheckpointError, match=r"evil\.safetensors is not a safetensors file"):
        load_tensors(tmp_path, "pair", 2)


def test_a_full_disk_leaves_the_old_pair(tmp_path: Path) -> None:
    saved(tmp_path, 1.0)
    names = sorted(path.name for path in tmp_path.iterdir())
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        # The system refuses to let a file grow past this (Python ignores the signal and sees the error).
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        with pytest.raises(StorageError, match="pair-"):
            save_tensors(tmp_path, "pair", tensors(2.0, size=5000), {"format": 2})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert load_tensors(tmp_path, "pair", 2)[0]["a"][0] == 1.0


def test_killed_between_the_two_files_the_old_pair_is_loaded_and_the_next_save_tidies_up(tmp_path: Path) -> None:
    run, other = tmp_path / "run", tmp_path / "other"
    saved(run, 1.0)
    saved(other, 2.0)
    # What a kill leaves after the new tensors and before the new JSON.
    orphan = run / weights_of(other).name
    shutil.copy(weights_of(other), orphan)
    assert load_tensors(run, "pair", 2)[0]["a"][0] == 1.0
    saved(run, 3.0)
    assert load_tensors(run, "pair", 2)[0]["a"][0] == 3.0
    assert not orphan.exists()


def test_a_pair_replaced_while_it_is_read_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved(tmp_path, 1.0)
    writes = iter([2.0])

    def read_then_replaced(path: Path) -> bytes:
        data = read_regular(path)
        for value in writes:
            saved(tmp_path, value)
        return data

    monkeypatch.setattr(tensor_file, "read_regular", read_then_replaced)
    loaded, document = load_tensors(tmp_path, "pair", 2)
    assert loaded["a"][0] == 2.0
    assert document == json.loads(path.read_bytes())
