"""Locks of directories, between descriptors and between processes."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from everplace import locking
from everplace.errors import ConfigError
from everplace.locking import locked, waiting_turn


def test_one_process_at_a_time_writes_into_a_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locking, "_SECONDS_TO_LET_GO", 0.2)
    out = tmp_path / "deep" / "run"
    with locked(out):
        with pytest.raises(ConfigError, match="run is being written by another process"), locked(out):
            pass
        with locked(tmp_path / "another"):
            pass
    with locked(out):
        pass
    assert list(out.iterdir()) == []


def test_those_who_want_the_same_file_take_turns(tmp_path: Path) -> None:
    target = tmp_path / "weights" / "file.bin"
    inside: list[int] = []

    def make(number: int) -> None:
        with waiting_turn(target):
            assert not inside
            inside.append(number)
            time.sleep(0.05)
            inside.remove(number)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(make, range(8)))
    assert list(target.parent.iterdir()) == []


@pytest.mark.slow
def test_the_lock_ends_with_its_process(tmp_path: Path) -> None:
    context = multiprocessing.get_context("forkserver")
    process = context.Process(target=_hold, args=(tmp_path,))
    process.start()
    while not (tmp_path / "held").exists():
        assert process.is_alive()
    process.kill()
    process.join()
    with locked(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["held"]


def _hold(out: Path) -> None:
    with locked(out):
        (out / "held").touch()
        time.sleep(60)
