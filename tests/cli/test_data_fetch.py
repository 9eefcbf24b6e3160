"""`everplace data fetch`, against a real server."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from tests.file_server import FileServer, Trouble
from tests.forked import ForkedProcess

from everplace.cli import main
from everplace.importing import catalogue
from everplace.importing.catalogue import DataFile, DataSet

PIECE = 2**16
CODE = """import sys
from everplace.cli import main
from everplace.importing import catalogue
from everplace.importing.catalogue import DataFile, DataSet
file = DataFile('walk.zip', sys.argv[1])
catalogue.DATA_SETS = (DataSet('walk', 'a walk', 'research only', 'Somebody, 2020', files=(file,), kind='nordland'),)
sys.exit(main.run(['data', 'fetch', 'walk', '--out', *sys.argv[2:]]))
"""


@pytest.fixture
def listed(server: FileServer, monkeypatch: pytest.MonkeyPatch) -> DataSet:
    """A catalogue with one data set, which the server has."""
    file = DataFile("walk.zip", server.url)
    data_set = DataSet("walk", "a walk", "research only", "Somebody, 2020", files=(file,), kind="gardens_point")
    monkeypatch.setattr(catalogue, "DATA_SETS", (data_set,))
    return data_set


def test_licence_and_citation_come_before_the_file(
    server: FileServer, listed: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["data", "fetch", "walk", "--out", str(tmp_path / "my walk"), "--yes", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err.splitlines()[:3] == ["a walk", "licence: research only", "cite: Somebody, 2020"]
    assert "no hash is published for walk" in err
    result = json.loads(out)
    assert result["files"] == [
        {"name": "walk.zip", "bytes": len(server.content), "sha256": server.sha256, "published": False}
    ]
    assert result["directory"] == str(tmp_path / "my walk")
    assert (tmp_path / "my walk" / "walk.zip").read_bytes() == server.content


def test_it_says_which_command_comes_next(listed: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = str(tmp_path / "my walk")
    assert main.run(["data", "fetch", "walk", "--out", where, "--yes"]) == 0
    out = capsys.readouterr().out
    assert f"next       everplace data import gardens_point '{where}' --out my-route" in out


def test_nobody_is_asked_where_nobody_sits(
    server: FileServer, listed: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["data", "fetch", "walk", "--out", str(tmp_path)]) == 2
    assert "read it and give --yes" in capsys.readouterr().err
    assert server.requests == []


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(("answer", "fetched"), [("y\n", True), ("n\n", False)])
def test_a_person_at_a_terminal_is_asked(server: FileServer, tmp_path: Path, answer: str, fetched: bool) -> None:
    import pty

    controller, terminal = pty.openpty()
    os.write(controller, answer.encode())
    pipes: dict[str, Any] = {"stdin": terminal, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = ForkedProcess("-c", CODE, server.url, tmp_path, **pipes)
    _, err = process.communicate(timeout=60)
    os.close(terminal)
    os.close(controller)
    assert process.returncode == 0, err
    assert "licence: research only" in err
    assert (tmp_path / "walk.zip").exists() == fetched
    assert ("nothing was fetched" in err) != fetched


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["kaist", "--yes"], "kaist cannot be fetched: its sites"),
        (["oxford"], "there is no data set 'oxford' to fetch; choose one of nordland64"),
    ],
)
def test_refusals(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["data", "fetch", *arguments]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert message in line


def test_a_file_that_is_gone_is_a_failure_of_the_machine(
    server: FileServer, listed: DataSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server.troubles = [Trouble(status=404)]
    assert main.run(["data", "fetch", "walk", "--out", str(tmp_path), "--yes"]) == 1
    assert "does not exist (HTTP 404)" in capsys.readouterr().err


def test_ctrl_c_in_the_middle_is_answered_at_once_and_nothing_is_lost(
    server: FileServer, listed: DataSet, tmp_path: Path
) -> None:
    sent = 30 * PIECE  # of less than a whole piece nothing is written until the connection ends
    server.troubles = [Trouble(send=sent, stall=True)]
    partial = tmp_path / ".walk.zip.download"
    with ForkedProcess("-c", CODE, server.url, tmp_path, "--yes", stderr=subprocess.PIPE) as process:
        deadline = time.monotonic() + 60
        while not partial.exists() or partial.stat().st_size < sent:
            assert time.monotonic() < deadline, "nothing was downloaded"
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=20)  # well below the 30 seconds after which a server counts as dead
    assert process.returncode == 130
    assert err.splitlines()[-1] == "everplace: stopped; what was finished is kept"
    assert main.run(["data", "fetch", "walk", "--out", str(tmp_path), "--yes"]) == 0
    assert server.asked == ["", f"bytes={sent}-"]
    assert (tmp_path / "walk.zip").read_bytes() == server.content
