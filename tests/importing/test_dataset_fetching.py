from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.file_server import FileServer, Trouble

from everplace import downloads
from everplace.errors import DownloadError, InputError, StorageError
from everplace.importing.catalogue import DataFile, DataSet, HubFolder
from everplace.importing.dataset_fetching import LOCK_FILE, default_directory, fetch_data_set

TREE = "/api/datasets/someone/route/tree/main/data"


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloads, "_FIRST_WAIT", 0.01)


def data_set(server: FileServer, *, sha256: str | None = None, size: int | None = None) -> DataSet:
    file = DataFile("file.bin", server.url, sha256, size)
    return DataSet("route", "a route", "CC0", "Somebody, 2020", files=(file,), kind="nordland")


def locked(directory: Path) -> list[dict[str, object]]:
    files: list[dict[str, object]] = json.loads((directory / LOCK_FILE).read_text())["files"]
    return files


def test_a_published_hash_is_wanted(server: FileServer, tmp_path: Path) -> None:
    fetched = fetch_data_set(data_set(server, sha256=server.sha256), tmp_path)
    assert (tmp_path / "file.bin").read_bytes() == server.content
    assert [file.published for file in fetched.files] == [True]
    shutil.rmtree(tmp_path)
    with pytest.raises(DownloadError, match=f"{server.sha256} where 0000.* is published"):
        fetch_data_set(data_set(server, sha256="0" * 64), tmp_path)
    assert not (tmp_path / LOCK_FILE).exists()


def test_the_hash_found_first_is_wanted_from_then_on(server: FileServer, tmp_path: Path) -> None:
    fetched = fetch_data_set(data_set(server), tmp_path)
    assert fetched.files == (DataFile("file.bin", server.url, server.sha256, len(server.content)),)
    assert locked(tmp_path) == [
        {
            "name": "file.bin",
            "url": server.url,
            "sha256": server.sha256,
            "size": len(server.content),
            "published": False,
        }
    ]
    assert fetch_data_set(data_set(server), tmp_path) == fetched
    assert len(server.requests) == 1

    (tmp_path / "file.bin").write_bytes(b"damaged here")
    assert fetch_data_set(data_set(server), tmp_path) == fetched
    assert (tmp_path / "file.bin").read_bytes() == server.content

    (tmp_path / "file.bin").unlink()
    server.content, server.etag = b"?" * len(server.content), '"2"'
    with pytest.raises(DownloadError, match=r"came first \(remove .*fetched\.json to trust the new one\)"):
        fetch_data_set(data_set(server), tmp_path)
    (tmp_path / LOCK_FILE).unlink()
    assert fetch_data_set(data_set(server), tmp_path).files[0].sha256 == server.sha256


def test_it_goes_on_where_it_was_broken_off(server: FileServer, tmp_path: Path) -> None:
    server.troubles = [Trouble(send=15 * 2**16), *[Trouble(status=503)] * 3]
    with pytest.raises(DownloadError, match="HTTP 503"):
        fetch_data_set(data_set(server), tmp_path)
    assert not (tmp_path / LOCK_FILE).exists()
    fetch_data_set(data_set(server), tmp_path)
    assert server.asked[-1] == f"bytes={15 * 2**16}-"
    assert (tmp_path / "file.bin").read_bytes() == server.content


class Hub(NamedTuple):
    data_set: DataSet
    files: dict[str, bytes]


@pytest.fixture
def hub(server: FileServer) -> Hub:
    """A folder of three large files, one small one and a directory, listed as the Hub does."""
    files = {f"{season}.tar.gz": season.encode() * 10_000 for season in ("fall", "summer", "winter")}
    files["list.tar.gz"] = b"small"
    listing: list[dict[str, object]] = [
        {"type": "directory", "oid": "a1", "size": 0, "path": "data/more"},
        {"type": "file", "oid": "a2", "size": 3, "path": "data/readme.md"},
    ]
    for name, content in files.items():
        server.files[f"/datasets/someone/route/resolve/main/data/{name}"] = content
        entry: dict[str, object] = {"type": "file", "oid": "a3", "size": len(content), "path": f"data/{name}"}
        if name != "list.tar.gz":
            entry["lfs"] = {"oid": hashlib.sha256(content).hexdigest(), "size": len(content), "pointerSize": 135}
        listing.append(entry)
    server.files[TREE] = json.dumps(listing).encode()
    server.etag = ""
    folder = HubFolder("someone/route", "data", ".tar.gz", server.url.rpartition("/")[0])
    return Hub(DataSet("hubbed", "a route", "CC0", "Somebody, 2020", hub=folder, kind="nordland"), files)


def test_a_folder_of_the_hub_with_the_hashes_of_its_listing(server: FileServer, hub: Hub, tmp_path: Path) -> None:
    fetched = fetch_data_set(hub.data_set, tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.gz")} == hub.files
    assert {file.name: file.published for file in fetched.files} == {
        "fall.tar.gz": True,
        "summer.tar.gz": True,
        "winter.tar.gz": True,
        "list.tar.gz": False,
    }
    asked = len(server.requests)
    assert fetch_data_set(hub.data_set, tmp_path) == fetched
    assert len(server.requests) == asked


def test_another_file_than_the_listing_says(server: FileServer, hub: Hub, tmp_path: Path) -> None:
    server.files["/datasets/someone/route/resolve/main/data/fall.tar.gz"] = b"FALL" * 10_000
    with pytest.raises(DownloadError, match=r"fall\.tar\.gz has the SHA-256 .* is published"):
        fetch_data_set(hub.data_set, tmp_path)


@pytest.mark.parametrize("listing", [b"{", b"[3]", b'[{"type": "file"}]', b"{}", b'[{"type": "file", "path": "x"}]'])
def test_a_listing_that_is_none(server: FileServer, hub: Hub, tmp_path: Path, listing: bytes) -> None:
    server.files[TREE] = listing
    with pytest.raises(DownloadError, match="gave no list of files|names no file"):
        fetch_data_set(hub.data_set, tmp_path)


def test_too_little_space_is_said_before_anything_is_fetched(server: FileServer, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match=r"needs 1000000\.0 GB more, but only .* choose another place with `out`"):
        fetch_data_set(data_set(server, size=10**15), tmp_path / "not" / "there")
    assert server.requests == []
    assert not (tmp_path / "not").exists()


def lock(name: str, sha256: str) -> str:
    file = {"name": name, "url": "https://x/y", "sha256": sha256, "size": 1, "published": True}
    return json.dumps({"name": "route", "files": [file]})


@pytest.mark.parametrize("damage", ["{", "[]", '{"name": "route"}', lock("../x", "0" * 64), lock("x", "12")])
def test_a_damaged_lock_file(server: FileServer, tmp_path: Path, damage: str) -> None:
    (tmp_path / LOCK_FILE).write_text(damage)
    with pytest.raises(InputError, match=r"fetched\.json is damaged; remove it"):
        fetch_data_set(data_set(server), tmp_path)


def test_two_data_sets_do_not_share_a_directory(server: FileServer, hub: Hub, tmp_path: Path) -> None:
    fetch_data_set(data_set(server), tmp_path)
    with pytest.raises(InputError, match="holds the data set 'route'; choose another place"):
        fetch_data_set(hub.data_set, tmp_path)


def test_where_it_goes_by_default(server: FileServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path))
    assert default_directory(data_set(server)) == tmp_path / "data" / "route"
    assert fetch_data_set(data_set(server)).directory == tmp_path / "data" / "route"
