from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.errors import ConfigError, ImageError, RouteError, StorageError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.route import pack as module
from everplace.route.pack import default_cache, pack
from everplace.route.route import open_route
from everplace.route.traverse import Traverse

SPEC = ImageSpec(size=(16, 32))


@pytest.fixture
def winter(tiny_route: Path) -> Traverse:
    return open_route(tiny_route)["winter"]


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache"


def files(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())


@pytest.mark.parametrize("spec", [SPEC, ImageSpec(size=(16, 32), grey=True)])
def test_pixels_are_the_decoded_frames(winter: Traverse, cache: Path, spec: ImageSpec) -> None:
    packed = pack(winter, spec, cache=cache)
    assert len(packed) == 12
    assert packed.stems == winter.stems
    assert packed.pixels.shape == (12, 16, 32, spec.channels)
    assert packed.pixels.dtype == np.uint8
    assert isinstance(packed.pixels, np.memmap)
    assert not packed.pixels.flags.writeable
    np.testing.assert_array_equal(packed.pixels, np.stack([decode_image(path, spec) for path in winter.paths]))


def test_a_second_call_decodes_nothing(winter: Traverse, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = pack(winter, SPEC, cache=cache)
    before = {path: path.stat().st_mtime_ns for path in cache.rglob("*")}
    monkeypatch.setattr("everplace.route.pack.decode_images", None)
    np.testing.assert_array_equal(pack(winter, SPEC, cache=cache).pixels, first.pixels)
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("*")} == before


def test_settings_stems_and_content_each_make_a_pack_of_their_own(winter: Traverse, cache: Path) -> None:
    def packs() -> int:
        return len(list(cache.iterdir()))

    pack(winter, SPEC, cache=cache)
    pack(winter, ImageSpec(size=(32, 16)), cache=cache)
    pack(winter, ImageSpec(size=(16, 32), grey=True), cache=cache)
    pack(winter[:5], SPEC, cache=cache)
    pack(winter.take([1, 0]), SPEC, cache=cache)
    pack(winter.take([0, 1]), SPEC, cache=cache)
    assert packs() == 6
    Image.new("RGB", (64, 32), (1, 2, 3)).save(winter.paths[4])
    assert pack(winter, SPEC, cache=cache).pixels[4, 0, 0].tolist() == [1, 2, 3]
    assert packs() == 7


def test_a_route_that_moved_is_not_decoded_again(winter: Traverse, tiny_route: Path, cache: Path) -> None:
    pack(winter, SPEC, cache=cache)
    moved = tiny_route.rename(tiny_route.with_name("moved"))
    pack(open_route(moved)["winter"], SPEC, cache=cache)
    assert len(list(cache.iterdir())) == 1


def test_where_packs_are_kept(
    winter: Traverse, tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "chosen"))
    before = files(tiny_route)
    pack(winter, SPEC)
    (about,) = (tmp_path / "chosen" / "packed").glob("*/pack.json")
    assert json.loads(about.read_text())["stems"] == list(winter.stems)
    assert files(tiny_route) == before
    monkeypatch.delenv("EVERPLACE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_cache().parts[-2:] == ("everplace", "packed")


def test_size_and_frames_are_required(winter: Traverse, cache: Path) -> None:
    with pytest.raises(ConfigError, match="image size"):
        pack(winter, ImageSpec(), cache=cache)
    with pytest.raises(RouteError, match="no frames"):
        pack(winter[:0], SPEC, cache=cache)


def test_a_bad_image_leaves_nothing_behind(winter: Traverse, cache: Path) -> None:
    data = winter.paths[7].read_bytes()
    winter.paths[7].write_bytes(data[: len(data) // 2])
    with pytest.raises(ImageError, match=r"winter/7\.png"):
        pack(winter, SPEC, cache=cache)
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("damage", ["short", "long", "empty", "header", "shape", "gone", "zip"])
def test_an_altered_pack_is_made_again(winter: Traverse, cache: Path, damage: str) -> None:
    expected = np.array(pack(winter, SPEC, cache=cache).pixels)
    (path,) = cache.glob("*/pixels.npy")
    data = path.read_bytes()
    altered = {
        "short": data[:-1],
        "long": data + b"\0",
        "empty": b"",
        "header": b"\x93NUMPY\x09" + data[7:],
        "shape": data.replace(b"(12, 16, 32, 3)", b"(12, 32, 16, 3)"),
        "zip": b"PK\x03\x04" + data[4:],
    }
    path.unlink()
    if damage in altered:
        path.write_bytes(altered[damage])
    np.testing.assert_array_equal(pack(winter, SPEC, cache=cache).pixels, expected)
    assert path.read_bytes() == data
    assert len(list(cache.iterdir())) == 1


def pack_at_once(
    route: Path, cache: Path, start: multiprocessing.synchronize.Barrier, sums: multiprocessing.Queue[int]
) -> None:
    winter = open_route(route)["winter"]
    start.wait()
    for _ in range(5):
        sums.put(int(pack(winter, SPEC, cache=cache).pixels.astype(np.int64).sum()))


def test_two_processes_at_once(tiny_route: Path, cache: Path, tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    start, sums = context.Barrier(2), context.Queue()
    processes = [context.Process(target=pack_at_once, args=(tiny_route, cache, start, sums)) for _ in range(2)]
    for process in processes:
        process.start()
    found = {sums.get(timeout=60) for _ in range(10)}
    for process in processes:
        process.join()
        assert process.exitcode == 0
    expected = pack(open_route(tiny_route)["winter"], SPEC, cache=tmp_path / "other").pixels
    assert found == {int(expected.astype(np.int64).sum())}
    assert len(list(cache.iterdir())) == 1


def test_a_pack_that_another_process_has_just_finished_is_taken(
    winter: Traverse, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished: list[int] = []

    def meanwhile(_: Path) -> None:
        monkeypatch.setattr(module, "_remove_leftovers", lambda _: None)
        pack(winter, SPEC, cache=cache)
        (path,) = cache.glob("*/pixels.npy")
        finished.append(path.stat().st_ino)
        monkeypatch.setattr(module, "decode_images", None)

    monkeypatch.setattr(module, "_remove_leftovers", meanwhile)
    assert len(pack(winter, SPEC, cache=cache)) == 12
    (path,) = cache.glob("*/pixels.npy")
    assert finished == [path.stat().st_ino]


@pytest.mark.parametrize(("times", "works"), [(1, True), (2, False)])
def test_a_pack_that_is_set_aside_once_made_is_made_once_more(
    winter: Traverse, cache: Path, monkeypatch: pytest.MonkeyPatch, times: int, works: bool
) -> None:
    make, left = module._make, [None] * times

    def make_and_lose(directory: Path, *others: Any) -> None:
        make(directory, *others)
        if left:
            left.pop()
            shutil.rmtree(directory)

    monkeypatch.setattr(module, "_make", make_and_lose)
    if works:
        assert len(pack(winter, SPEC, cache=cache)) == 12
    else:
        with pytest.raises(StorageError, match="altered while it was made"):
            pack(winter, SPEC, cache=cache)


STALLING = """
import sys, time
from pathlib import Path
from everplace.route import pack as module
from everplace.route.route import open_route
from everplace.images.decoding import ImageSpec

decode = module.decode_images
def stall(paths, spec):
    for number, image in enumerate(decode(paths, spec)):
        yield image
        if number == 5:
            print("half", flush=True)
            time.sleep(60)
module.decode_images = stall
module.pack(open_route(sys.argv[1])["winter"], ImageSpec(size=(16, 32)), cache=Path(sys.argv[2]))
"""


@pytest.fixture
def stalled(tiny_route: Path, cache: Path) -> subprocess.Popen[str]:
    """A process that stands still in the middle of packing."""
    command = [sys.executable, "-c", STALLING, str(tiny_route), str(cache)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "half\n"
    return process


def test_killed_in_the_middle(stalled: subprocess.Popen[str], winter: Traverse, cache: Path) -> None:
    stalled.send_signal(signal.SIGKILL)
    stalled.communicate()
    (leftover,) = cache.iterdir()
    assert leftover.name.endswith(".part")

    packed = pack(winter, SPEC, cache=cache)

    np.testing.assert_array_equal(packed.pixels, np.stack([decode_image(path, SPEC) for path in winter.paths]))
    (whole,) = cache.iterdir()
    assert files(whole) == ["pack.json", "pixels.npy"]


def test_the_work_of_a_living_process_is_left_alone(
    stalled: subprocess.Popen[str], winter: Traverse, cache: Path
) -> None:
    try:
        (living,) = cache.iterdir()
        pack(winter, SPEC, cache=cache)
        assert living.is_dir()
        assert len(list(cache.iterdir())) == 2
    finally:
        stalled.send_signal(signal.SIGINT)
        stalled.communicate()
    assert len(list(cache.iterdir())) == 1


def test_a_directory_that_is_about_to_be_locked_is_left_alone(winter: Traverse, cache: Path) -> None:
    young, old = cache / ".aa.1-0.part", cache / ".bb.2-0.part"
    young.mkdir(parents=True)
    old.mkdir()
    os.utime(old, (time.time() - 3600,) * 2)
    pack(winter, SPEC, cache=cache)
    assert young.is_dir()
    assert not old.exists()


FULL = """
import resource, sys
from pathlib import Path
from everplace.images.decoding import ImageSpec
from everplace.route.pack import pack
from everplace.route.route import open_route
from everplace.errors import StorageError

resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    pack(open_route(sys.argv[1])["winter"], ImageSpec(size=(16, 32)), cache=Path(sys.argv[2]))
except StorageError as error:
    print(error)
"""


def test_a_full_disk_is_one_error_and_leaves_nothing(tiny_route: Path, cache: Path) -> None:
    command = [sys.executable, "-c", FULL, str(tiny_route), str(cache)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stderr == ""
    assert done.stdout.startswith(f"cannot write {cache}")
    assert "EVERPLACE_CACHE" in done.stdout
    assert list(cache.iterdir()) == []


def test_a_cache_that_cannot_be_made(winter: Traverse, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="EVERPLACE_CACHE"):
        pack(winter, SPEC, cache=tmp_path / "file" / "cache")
