"""Weight files: official names, checks of layout and hash, no code run, fetched from a server and kept."""

from __future__ import annotations

import hashlib
import io
import pickle
import tarfile
import threading
from collections.abc import Iterable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, TypeVar

import pytest
import torch
from torch import Tensor, nn

from everplace.describe.pretrained.weights import PublishedWeights, fetch_weights, load_weights, weight_file
from everplace.errors import MethodError

T = TypeVar("T")


def small_network() -> nn.ModuleDict:
    with torch.device("meta"):
        return nn.ModuleDict({"features": nn.Sequential(nn.Conv2d(3, 2, 3), nn.ReLU(), nn.Linear(2, 4))})


def some_weights(**more: Tensor) -> dict[str, Tensor]:
    rng = torch.Generator().manual_seed(0)
    shapes = {"0.weight": (2, 3, 3, 3), "0.bias": (2,), "2.weight": (4, 2), "2.bias": (4,)}
    return {f"features.{key}": torch.randn(shape, generator=rng) for key, shape in shapes.items()} | more


class RunsCode:
    """Makes the file named in it when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("zipped", [True, False])
def test_weights_are_loaded_and_their_hash_returned(tmp_path: Path, zipped: bool) -> None:
    path = tmp_path / "w.pth"
    tensors = some_weights(**{"classifier.6.weight": torch.ones(3)})
    torch.save(tensors, path, _use_new_zipfile_serialization=zipped)
    network = small_network()
    digest = load_weights(path, network, "Small")
    assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
    path.write_bytes(b"\0" * path.stat().st_size)  # the numbers must not lie in the file any more
    loaded = network.state_dict()
    assert sorted(loaded) == sorted(set(tensors) - {"classifier.6.weight"})
    assert all(torch.equal(value, tensors[key]) for key, value in loaded.items())


def test_half_precision_is_widened(tmp_path: Path) -> None:
    path = tmp_path / "w.pth"
    torch.save({key: value.half() for key, value in some_weights().items()}, path)
    network = small_network()
    load_weights(path, network, "Small")
    assert {value.dtype for value in network.state_dict().values()} == {torch.float32}


@pytest.mark.parametrize("protocol", [2, 4])
def test_a_file_that_would_run_code_is_refused(tmp_path: Path, protocol: int) -> None:
    marker = tmp_path / "marker"
    for write in (torch.save, lambda value, path: path.write_bytes(pickle.dumps(value, protocol))):
        path = tmp_path / "w.pth"
        write({**some_weights(), "features.0.bias": RunsCode(marker)}, path)
        with pytest.raises(MethodError, match=r"w\.pth is refused: .* could run code") as caught:
            load_weights(path, small_network(), "Small")
        assert "\n" not in str(caught.value)
        assert not marker.exists()


def test_a_tar_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.pth"
    with tarfile.open(path, "w") as archive:
        content = pickle.dumps(1)
        entry = tarfile.TarInfo("pickle")
        entry.size = len(content)
        archive.addfile(entry, io.BytesIO(content))
    with pytest.raises(MethodError, match="is refused"):
        load_weights(path, small_network(), "Small")


@pytest.mark.parametrize("part", [0, 10, 400])
def test_a_truncated_file_is_refused(tmp_path: Path, part: int) -> None:
    path = tmp_path / "w.pth"
    torch.save(some_weights(), path)
    path.write_bytes(path.read_bytes()[:part])
    with pytest.raises(MethodError, match=r"w\.pth is refused: it is damaged"):
        load_weights(path, small_network(), "Small")


def test_weights_of_another_network_are_refused_by_name_and_shape(tmp_path: Path) -> None:
    path = tmp_path / "w.pth"
    tensors = some_weights()
    torch.save({**tensors, "features.2.weight": torch.ones(4, 3)}, path)
    with pytest.raises(MethodError, match=r"features\.2\.weight has shape \(4, 3\), wanted \(4, 2\)"):
        load_weights(path, small_network(), "Small")
    del tensors["features.0.weight"]
    torch.save(tensors, path)
    with pytest.raises(MethodError, match=r"no weights of Small: features\.0\.weight is missing"):
        load_weights(path, small_network(), "Small")
    torch.save([1, 2], path)
    with pytest.raises(MethodError, match="is refused"):
        load_weights(path, small_network(), "Small")


def test_a_name_that_states_a_hash_is_held_to_it(tmp_path: Path) -> None:
    plain = tmp_path / "plain.pth"
    torch.save(some_weights(), plain)
    digest = hashlib.sha256(plain.read_bytes()).hexdigest()
    right, wrong = tmp_path / f"net-{digest[:8]}.pth", tmp_path / "net-01234567.pth"
    for path in (right, wrong):
        path.write_bytes(plain.read_bytes())
    assert load_weights(right, small_network(), "Small") == digest
    with pytest.raises(MethodError, match=f"begins with {digest[:8]} and not with 01234567 as its name says"):
        load_weights(wrong, small_network(), "Small")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "none.pth", tmp_path):
        with pytest.raises(MethodError, match="there is no weight file"):
            load_weights(path, small_network(), "Small")


def test_a_given_file_comes_before_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    published = PublishedWeights("Small", "https://a.org/small-01234567.pth", "0" * 64, 3)
    assert weight_file(str(tmp_path / "own.pth"), published) == tmp_path / "own.pth"
    kept = tmp_path / "cache" / "weights" / "small-01234567.pth"
    with pytest.raises(MethodError) as caught:
        weight_file("", published)
    assert str(caught.value) == (
        f"Small needs its published weights: download https://a.org/small-01234567.pth (3 MB) and put it at {kept}"
    )
    kept.parent.mkdir(parents=True)
    kept.touch()
    assert weight_file("", published) == kept


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """A web server on this machine, and the directory it serves."""
    root = tmp_path / "served"
    root.mkdir()

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: Any) -> None:
            pass

    running = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root)))
    thread = threading.Thread(target=running.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{running.server_port}", root
    running.shutdown()
    running.server_close()
    thread.join()


def test_published_weights_are_fetched_once_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, server: tuple[str, Path]
) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    address, root = server
    torch.save(some_weights(), root / "small.pth")
    digest = hashlib.sha256((root / "small.pth").read_bytes()).hexdigest()
    published = PublishedWeights("Small", f"{address}/small.pth", digest, 1)
    told: list[str] = []

    def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        told.append(what)
        yield from items

    fetch_weights(published, progress)
    assert told == ["fetching small.pth"]
    assert load_weights(weight_file("", published), small_network(), "Small") == digest
    (root / "small.pth").unlink()
    fetch_weights(published)
    assert published.path.is_file()


def test_another_file_than_the_published_one_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, server: tuple[str, Path]
) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    address, root = server
    torch.save(some_weights(), root / "small.pth")
    published = PublishedWeights("Small", f"{address}/small.pth", "0" * 64, 1)
    with pytest.raises(MethodError, match="Small needs its published weights: .* SHA-256 .* put it at"):
        fetch_weights(published)
    assert not published.path.exists()


def test_without_a_server_one_sentence_says_how_to_get_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    published = PublishedWeights("Small", "http://127.0.0.1:9/small.pth", "0" * 64, 1)
    with pytest.raises(MethodError) as caught:
        fetch_weights(published)
    message = str(caught.value)
    assert message.startswith("Small needs its published weights: cannot fetch http://127.0.0.1:9/small.pth")
    assert message.endswith(f"and put it at {published.path}")
    assert "\n" not in message
