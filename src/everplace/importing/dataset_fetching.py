"""Fetching a data set of the catalogue into a directory, with a lock file that says what was fetched.

`fetched.json` beside the files holds the address, size and SHA-256 of each. Where no hash is published, the one found
at the first fetch is written down and wanted from then on (trust on first use).
"""

from __future__ import annotations

import json
import re
import shutil
import tempfile
import urllib.parse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from everplace.downloads import fetch, sha256_of
from everplace.errors import DownloadError, InputError, StorageError
from everplace.files import cache_directory, readable, write_json
from everplace.importing.catalogue import DataFile, DataSet, HubFolder
from everplace.progress import Progress, quiet

__all__ = ["LOCK_FILE", "Fetched", "default_directory", "fetch_data_set"]

LOCK_FILE = "fetched.json"
"""What was fetched, in the directory of the files."""

_HASH = re.compile("[0-9a-f]{64}")


@dataclass(frozen=True)
class Fetched:
    """A data set on disk.

    Attributes:
        directory: Where it is.
        files: Its files; each with its size and hash.
        published: For each file, whether its hash was published by the source, and not found at the first fetch.
    """

    directory: Path
    files: tuple[DataFile, ...]
    published: tuple[bool, ...]


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
    known = _read_lock(lock, data_set)
    listed = tuple((file, file.sha256 is not None) for file in _list(data_set)) if known is None else known
    _require_space(directory, [file for file, _ in listed])
    for file, has_hash in listed:
        said = "is published" if has_hash else f"came first (remove {readable(lock)} to trust the new one)"
        fetch(file.url, file.sha256, directory / file.name, progress, known=said)
    files = tuple(_measured(directory, file) for file, _ in listed)
    published = tuple(published for _, published in listed)
    _write_lock(lock, data_set, files, published)
    return Fetched(directory, files, published)


def _list(data_set: DataSet) -> tuple[DataFile, ...]:
    return (*data_set.files, *(() if data_set.hub is None else _list_hub(data_set.hub)))


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
            "space or choose another place with --out"
        )


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _measured(directory: Path, file: DataFile) -> DataFile:
    path = directory / file.name
    return replace(file, sha256=file.sha256 or sha256_of(path), size=path.stat().st_size)


def _read_lock(lock: Path, data_set: DataSet) -> tuple[tuple[DataFile, bool], ...] | None:
    """Reads what an earlier fetch wrote: the files, and whether their hashes were published; None: there was none.

    Raises:
        InputError: It is of another data set, or damaged.
    """
    try:
        content = json.loads(lock.read_text(encoding="utf-8"))
        name = content["name"]
        files = tuple(
            (DataFile(file["name"], file["url"], file["sha256"], file["size"]), bool(file["published"]))
            for file in content["files"]
        )
        sound = all(
            Path(file.name).name == file.name and _HASH.fullmatch(file.sha256 or "") and isinstance(file.size, int)
            for file, _ in files
        )
        if not sound:
            raise ValueError
    except FileNotFoundError:
        return None
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(f"{readable(lock)} is damaged; remove it to fetch {data_set.name} anew") from error
    if name != data_set.name:
        raise InputError(f"{readable(lock.parent)} holds the data set {name!r}; choose another place with --out")
    return files


def _write_lock(lock: Path, data_set: DataSet, files: tuple[DataFile, ...], published: tuple[bool, ...]) -> None:
    content = {
        "name": data_set.name,
        "licence": data_set.licence,
        "citation": data_set.citation,
        "files": [{**asdict(file), "published": said} for file, said in zip(files, published, strict=True)],
    }
    write_json(lock, content)
