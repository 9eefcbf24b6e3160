"""Writing whole files: what stands at a path already is replaced, kept or refused."""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from everplace.errors import ConfigError, StorageError
from everplace.files import remove_leftovers, whole_directory, whole_file, write_json, write_text

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
