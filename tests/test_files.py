"""Writing whole files: what stands at a path already is replaced, kept or refused."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

import pytest

from everplace.errors import ConfigError
from everplace.files import write_text

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no FIFOs in directories")


def test_a_file_is_replaced_and_a_link_to_one_too(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("old")
    (tmp_path / "link").symlink_to("old")
    (tmp_path / "nowhere").symlink_to("gone")
    for name in ("link", "nowhere", "old", "new"):
        write_text(tmp_path / name, name)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        name: name for name in ("link", "nowhere", "old", "new")
    }


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
