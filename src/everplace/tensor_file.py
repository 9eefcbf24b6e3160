"""A pair of files that belong together: JSON that says what it is, safetensors that hold the numbers.

The JSON names the tensor file by its hash and is written last, by rename, so that a reader sees the old pair or the
new one and never half of each, and a file that was altered is noticed. Loading runs no code from the files.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from everplace.errors import CheckpointError
from everplace.files import readable, write_bytes, write_json
from everplace.git_lfs import POINTER_BYTES, is_pointer, pointer_sentence
from everplace.regular_files import read_regular

__all__ = ["has_tensors", "load_tensors", "save_tensors"]


def save_tensors(directory: Path, name: str, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Writes `<name>.json` and `<name>-<hash>.safetensors`; an earlier pair of that name is replaced.

    Args:
        directory: Where the pair goes; made if missing.
        name: Common first part of both file names.
        tensors: What to keep; copied to the CPU.
        about: JSON values that say what the tensors are.

    Raises:
        StorageError: Writing failed; the earlier pair still stands.
    """
    data = save({key: tensor.detach().cpu().contiguous() for key, tensor in tensors.items()})
    digest = hashlib.sha256(data).hexdigest()
    file = f"{name}-{digest[:16]}.safetensors"
    write_bytes(directory / file, data)
    document = {**about, "tensors": {"file": file, "sha256": digest}}
    write_json(directory / f"{name}.json", document)
    for old in sorted(directory.glob(f"{name}-*.safetensors")):
        if old.name != file:
            old.unlink(missing_ok=True)


def has_tensors(directory: Path, name: str) -> bool:
    """Whether a pair of that name stands in the directory."""
    return (directory / f"{name}.json").is_file()


def load_tensors(directory: Path, name: str, format_version: int) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Reads a pair that `save_tensors` wrote.

    Args:
        directory: Where the pair lies.
        name: Common first part of both file names.
        format_version: The `format` that the JSON must state.

    Returns:
        The tensors, on the CPU, and the JSON document.

    Raises:
        CheckpointError: Something is missing, malformed, of another version, was altered, or is not finite.
    """
    document = _read_document(directory, name, format_version)
    path = directory / f"{name}.json"
    with contextlib.suppress(FileNotFoundError):
        return _read_tensors(path, document.get("tensors")), document
    # A writer may have replaced the pair since the JSON was read.
    document = _read_document(directory, name, format_version)
    try:
        return _read_tensors(path, document.get("tensors")), document
    except FileNotFoundError as error:
        raise CheckpointError(
            f"{readable(error.filename)} cannot be read ({error.strerror}); restore it or train again"
        ) from None


def _refuse(number: str) -> None:
    raise ValueError(f"{number} is no number of JSON")


def _read_document(directory: Path, name: str, format_version: int) -> dict[str, Any]:
    path = directory / f"{name}.json"
    try:
        document = json.loads(read_regular(path).decode("utf-8"), parse_constant=_refuse)
    except FileNotFoundError:
        raise CheckpointError(f"{readable(path)} is missing; {readable(directory)} holds no finished {name}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise CheckpointError(f"{readable(path)} cannot be read as JSON ({error}); restore it or train again") from None
    if not isinstance(document, dict) or document.get("format") != format_version:
        found = document.get("format") if isinstance(document, dict) else None
        raise CheckpointError(
            f"{readable(path)} has format {found!r}, but this version of everplace reads format {format_version}; "
            "use the version that wrote it, or train again"
        )
    return document


def _read_tensors(path: Path, entry: Any) -> dict[str, Tensor]:
    """The tensors of an entry; FileNotFoundError if their file is not there."""
    file, digest = (entry.get("file"), entry.get("sha256")) if isinstance(entry, dict) else (None, None)
    if not isinstance(file, str) or not re.fullmatch(r"[\w.-]+\.safetensors", file):
        raise CheckpointError(f"{readable(path)} names no tensor file beside it; restore it or train again")
    try:
        data = read_regular(path.parent / file)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise CheckpointError(
            f"{readable(path.parent / file)} cannot be read ({error.strerror}); restore it or train again"
        ) from None
    if is_pointer(data[:POINTER_BYTES]):
        raise CheckpointError(pointer_sentence(readable(path.parent / file)))
    if hashlib.sha256(data).hexdigest() != digest:
        raise CheckpointError(
            f"{readable(path.parent / file)} is not the file that {path.name} describes: it was altered or "
            "damaged; restore it or train again"
        )
    try:
        tensors = load(data)
    except SafetensorError as error:
        raise CheckpointError(f"{readable(path.parent / file)} is not a safetensors file ({error})") from None
    for key, tensor in tensors.items():
        if tensor.is_floating_point() and not _all_finite(tensor):
            raise CheckpointError(
                f"{readable(path.parent / file)} holds NaN or infinity in {key!r}; restore it or train again"
            )
    return tensors


def _all_finite(tensor: Tensor) -> bool:
    # Of the shortest types torch cannot say it.
    return bool(torch.isfinite(tensor if tensor.itemsize >= 2 else tensor.float()).all())
