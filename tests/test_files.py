"""Writing whole files: what stands at a path already is replaced, kept or refused."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from everplace.errors import ConfigError, InputError, StorageError
from everplace.files import (
    STANDARD_OUTPUT,
    filled_directory,
    remove_leftovers,
    whole_directory,
    whole_file,
    write_json,
    write_text,
)
from everplace.route.csv_table import read_poses
from everplace.route.route_toml import read_route_toml
from everplace.tensor_file import load_tensors

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no FIFOs in directories")


def test_a_file_is_replaced_and_a_link_is_followed(tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    (there / "old").write_text("old")
    (tmp_path / "link").symlink_to("there/old")
    (tmp_path / "nowhere").symlink_to("there/gone")
    for name in ("link", "nowhere", "new"):
        write_text(tmp_path / name, name)
    assert {path.name: path.read_text() for path in there.iterdir()} == {"old": "link", "gone": "nowhere"}
    assert {path.name for path in tmp_path.iterdir() if path.is_symlink()} == {"link", "nowhere"}
    write_text(there / "old", "anew")
    assert (tmp_path / "link").read_text() == "anew"
    assert {path.name for path in tmp_path.iterdir()} == {"there", "link", "nowhere", "new"}


@pytest.mark.parametrize("writing", [whole_file, whole_directory])
def test_an_output_is_not_blamed_for_an_input(tmp_path: Path, writing: Any) -> None:
    with pytest.raises(FileNotFoundError, match=r"input\.txt"), writing(tmp_path / "out"):
        (tmp_path / "input.txt").read_text()
    for inside in ("", "deep/er"):
        with pytest.raises(StorageError, match="cannot write .*out: No such file"), writing(tmp_path / "out") as out:
            (out / inside / "missing" / "file").write_text("text")
    with pytest.raises(StorageError, match="cannot write .*out: No space left"), writing(tmp_path / "out"):
        raise OSError(errno.ENOSPC, "full")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("linked", [False, True])
def test_a_fifo_is_refused_and_stays(tmp_path: Path, linked: bool) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("fifo")
    with pytest.raises(ConfigError, match=r"is a device, a FIFO or a socket; choose a file"):
        write_text(tmp_path / ("link" if linked else "fifo"), "text")
    assert (tmp_path / "fifo").is_fifo()
    assert (tmp_path / "link").is_symlink()
    assert len(list(tmp_path.iterdir())) == 2


def test_a_socket_is_refused_and_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the whole path of a socket may not be long
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(ConfigError, match=r"socket is a device, a FIFO or a socket"):
            write_text(Path("socket"), "text")
        assert Path("socket").is_socket()


def test_only_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    below = tmp_path / "below"
    below.mkdir()
    for place in (tmp_path, below):
        with whole_file(place / "a.b.json") as temporary:
            temporary.write_bytes(b"")
        for name in (temporary.name, ".notes.part.txt", "a.json", ".x.12-abc.part.json"):
            (place / name).write_bytes(b"")
        (place / ".d.12-0123abcd.part").mkdir()
    with whole_file(tmp_path / "without_suffix") as temporary:
        temporary.write_bytes(b"")
    temporary.write_bytes(b"")
    remove_leftovers(tmp_path, tmp_path / "missing")
    kept = {".notes.part.txt", "a.json", ".x.12-abc.part.json", ".d.12-0123abcd.part"}
    assert {path.name for path in tmp_path.iterdir()} == kept | {"below", "a.b.json", "without_suffix"}
    assert len(list(below.iterdir())) == 6


def test_what_of_a_name_is_not_utf8_is_escaped_in_a_text(tmp_path: Path) -> None:
    write_text(tmp_path / "text", "x\udcff")
    assert (tmp_path / "text").read_bytes() == b"x\\udcff"
    write_json(tmp_path / "json", {"name": "x\udcff é"})
    assert json.loads((tmp_path / "json").read_bytes()) == {"name": "x\udcff é"}


def test_a_link_that_leads_to_itself_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    write_text(tmp_path / "loop", "text")
    assert (tmp_path / "loop").read_text() == "text"


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


@pytest.mark.parametrize("put", [_fifo, _device, _socket])
@pytest.mark.parametrize("reader", ["route.toml", "checkpoint.json", "poses.csv"])
def test_what_is_no_regular_file_is_refused_by_every_reader(
    tmp_path: Path, put: Callable[[Path], None], reader: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    put(Path(reader))
    readers: dict[str, Callable[[], object]] = {
        "route.toml": lambda: read_route_toml(tmp_path),
        "checkpoint.json": lambda: load_tensors(tmp_path, "checkpoint", 1),
        "poses.csv": lambda: read_poses(tmp_path / "poses.csv", ["a"]),
    }
    with pytest.raises(InputError, match=f"{reader}.*(not a regular file|No such device)"):
        readers[reader]()


@pytest.mark.parametrize("number", ["1e308", "-1e308", "1e31"])
def test_a_pose_that_nothing_can_be_computed_with_is_refused(tmp_path: Path, number: str) -> None:
    (tmp_path / "poses.csv").write_text(f"stem,x,y,heading\na,{number},0,0\n")
    with pytest.raises(InputError, match="poses.csv, row 2 holds a number beyond"):
        read_poses(tmp_path / "poses.csv", ["a"])


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"])
def test_an_open_file_is_not_replaced(tmp_path: Path, name: str) -> None:
    log, link = tmp_path / "log", tmp_path / "link"
    log.write_text("before\n")
    link.symlink_to("/dev/stdout")
    code = f"from everplace.files import *; from pathlib import Path; write_text(Path({str(tmp_path / name)!r}), 'new')"
    with log.open("a") as file:
        ended = subprocess.run([sys.executable, "-c", code], stdout=file, stderr=subprocess.PIPE, text=True)
    assert "is a device, a FIFO or a socket" in ended.stderr
    assert log.read_text() == "before\n"


def test_a_file_in_the_memory_of_dev_is_written() -> None:
    directory = Path("/dev/shm")
    if not os.access(directory, os.W_OK):
        pytest.skip("needs /dev/shm")
    path = directory / f"everplace-{os.getpid()}"
    write_text(path, "new")
    assert path.read_text() == "new"
    path.unlink()


def test_a_dash_is_standard_output(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="half"), whole_file(STANDARD_OUTPUT) as temporary:
        temporary.write_text("half")
        raise ValueError("half")
    write_text(STANDARD_OUTPUT, "Fähre\n")
    assert capfdbinary.readouterr().out == "Fähre\n".encode()


_KILLED = """
import os, signal, sys
from pathlib import Path
from everplace.files import *
with {call} as temporary:
    (temporary / "a").write_text("half") if temporary.is_dir() else temporary.write_text("half")
    print(temporary, flush=True)
    {end}
"""


@pytest.mark.parametrize(
    "call", ["whole_file(Path('a.csv'))", "whole_directory(Path('d'))", "filled_directory(Path())"]
)
def test_what_a_killed_process_left_is_swept_and_the_work_of_a_living_one_stays(tmp_path: Path, call: str) -> None:
    killed = _KILLED.format(call=call, end="os.kill(os.getpid(), signal.SIGKILL)")
    subprocess.run([sys.executable, "-c", killed], cwd=tmp_path, stdout=subprocess.PIPE)
    (left,) = tmp_path.iterdir()
    living = _KILLED.format(call=call, end="sys.stdin.read()")
    with subprocess.Popen(
        [sys.executable, "-c", living], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        working = tmp_path / process.stdout.readline().strip()
        assert not left.exists()
        code = "from pathlib import Path; from everplace.files import *; write_text(Path('other.txt'), '')"
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
        assert working.exists()
        process.communicate()
    assert not working.exists()


def test_what_another_machine_left_is_swept_after_a_day(tmp_path: Path) -> None:
    foreign = tmp_path / f".a.{os.getpid()}-00000000.part.csv"
    foreign.write_text("")
    write_text(tmp_path / "b", "")
    assert foreign.exists()
    os.utime(foreign, (0, 0))
    subprocess.run(
        [sys.executable, "-c", "from everplace.files import *; from pathlib import Path; write_text(Path('c'), '')"],
        cwd=tmp_path,
        check=True,
    )
    assert not foreign.exists()


def test_a_directory_is_filled_whole_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    with pytest.raises(ValueError, match="half"), filled_directory(out) as directory:
        (directory / "a").write_text("half")
        raise ValueError("half")
    assert list(tmp_path.iterdir()) == []
    out.mkdir(parents=True)
    (out / "a").write_text("old")
    (out / "mine").write_text("mine")
    with pytest.raises(ValueError, match="half"), filled_directory(out) as directory:
        (directory / "a").write_text("half")
        raise ValueError("half")
    assert {path.name: path.read_text() for path in out.iterdir()} == {"a": "old", "mine": "mine"}
    with filled_directory(out) as directory:
        (directory / "a").write_text("new")
    assert {path.name: path.read_text() for path in out.iterdir()} == {"a": "new", "mine": "mine"}
