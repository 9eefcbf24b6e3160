"""Fetching a data set of the catalogue into a directory, with a lock file that says what was fetched.

`fetched.json` beside the files holds the address, size and SHA-256 of each. Where no hash is published, the one found
at the first fetch is written down and wanted from then on (trust on first use).
"""

from __future__ import annotations

import json
import shutil
import tempfile
import urllib.parse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from pydantic import BaseModel

from everplace.downloads import fetch, sha256_of
from everplace.errors import DownloadError, InputError, StorageError
from everplace.files import cache_directory, readable, write_json
from everplace.importing.catalogue import DataFile, DataSet, HubFolder
from everplace.progress import Progress, quiet

__all__ = ["LOCK_FILE", "Fetched", "default_directory", "fetch_data_set"]

LOCK_FILE = "fetched.json"
"""What was fetched, in the directory of the files."""


@dataclass(frozen=True)
class Fetched:
    """A data set on disk.

    Attributes:
        directory: Where it is.
        files: Its files; each with its size and hash.
    """

    directory: Path
    files: tuple[DataFile, ...]


class _Lock(BaseModel):
    """The content of the lock file."""

    name: str
    licence: str = ""
    citation: str = ""
    files: tuple[DataFile, ...]


def default_directory(data_set: DataSet) -> Path:
    """Returns where a data set goes: `data/NAME` in $EVERPLACE_CACHE, or else in the user's cache directory."""
    return cache_directory("data") / data_set.name


def fetch_data_set(
    data_set: DataSet,
    directory: Path | None = None,
    progress: Progress = quiet,
) -> Fetched:
    """Fetches the files of a data set, one after the other; what is there already is only checked.

    Args:
        data_set: From the catalogue.
        directory: Where to put it; None: `default_directory`.
        progress: Told of the pieces of each file that have come.

    Returns:
        What is on disk then.

    Raises:
        DownloadError: A file could not be fetched, or is another one than was published, or than came first.
        InputError: The lock file was damaged.
        StorageError: There is too little space, or no permission to write.
    """
    directory = default_directory(data_set) if directory is None else directory
    lock = directory / LOCK_FILE
    wanted = _read_lock(lock, data_set) or _list(data_set)
    _require_space(directory, wanted)
    files = []
    for file in wanted:
        path = directory / file.name
        said = "is published" if file.published else f"came first (remove {readable(lock)} to trust the new one)"
        fetch(file.url, file.sha256, path, progress, known=said)
        files.append(replace(file, sha256=file.sha256 or sha256_of(path), size=path.stat().st_size))
    content = _Lock(name=data_set.name, licence=data_set.licence, citation=data_set.citation, files=tuple(files))
    write_json(lock, content.model_dump())
    return Fetched(directory, content.files)


def _list(data_set: DataSet) -> tuple[DataFile, ...]:
    files = (*data_set.files, *(() if data_set.hub is None else _list_hub(data_set.hub)))
    return tuple(replace(file, published=file.sha256 is not None) for file in files)


def _list_hub(hub: HubFolder) -> tuple[DataFile, ...]:
    """Asks the Hub for the files of a folder; large ones have their SHA-256 in the listing."""
    url = f"{hub.server}/api/datasets/{hub.repository}/tree/main/{hub.folder}"
    with tempfile.TemporaryDirectory() as scratch:
        text = fetch(url, None, Path(scratch) / "listing.json").read_text(encoding="utf-8")
    try:
        files = tuple(_hub_file(hub, item) for item in json.loads(text) if item["type"] == "file")
    except (ValueError, KeyError, TypeError) as error:
        raise DownloadError(f"{url} gave no list of files ({error!r}); fetch the set by hand from its page") from error
    files = tuple(file for file in files if file.name.endswith(hub.ending))
    if not files:
        raise DownloadError(f"{url} names no file that ends in {hub.ending}; the set has moved, look at its page")
    return files


def _hub_file(hub: HubFolder, item: dict[str, Any]) -> DataFile:
    path = str(item["path"])
    large = item.get("lfs") or {}
    url = f"{hub.server}/datasets/{hub.repository}/resolve/main/{urllib.parse.quote(path)}"
    return DataFile(
        PurePosixPath(path).name, url, large.get("oid", "").removeprefix("sha256:") or None, int(item["size"])
    )


def _require_space(directory: Path, files: Sequence[DataFile]) -> None:
    """Raises `StorageError` before a byte is fetched, if what is missing cannot fit."""
    missing = sum(max(0, (file.size or 0) - _size(directory / file.name)) for file in files)
    existing = next(path for path in (directory, *directory.absolute().parents) if path.exists())
    free = shutil.disk_usage(existing).free
    if missing > free:
        raise StorageError(
            f"{readable(directory)} needs {missing / 1e9:.1f} GB more, but only {free / 1e9:.1f} GB are free; free "
            "space or choose another place with `out`"
        )


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _read_lock(lock: Path, data_set: DataSet) -> tuple[DataFile, ...]:
    """Reads which files an earlier fetch brought; none: there was no such fetch.

    Raises:
        InputError: The lock file is of another data set, or damaged.
    """
    try:
        content = _Lock.model_validate_json(lock.read_bytes())
        if not all(file.sha256 for file in content.files):
            raise ValueError
    except FileNotFoundError:
        return ()
    except (OSError, ValueError) as error:
        raise InputError(f"{readable(lock)} is damaged; remove it to fetch {data_set.name} anew") from error
    if content.name != data_set.name:
        raise InputError(
            f"{readable(lock.parent)} holds the data set {content.name!r}; choose another place with `out`"
        )
    return content.files
