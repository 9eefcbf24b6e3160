"""A child process: what it writes arrives whole, and how it ends is told."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import IO

import pytest

from everplace.child_process import ChildError, output_of_child

SECONDS, MEMORY = 20.0, 2**30


def answer(out: IO[bytes], text: str) -> None:
    print("what a library says")
    out.write(text.encode())


def crash(out: IO[bytes]) -> None:
    out.write(b"half")
    out.flush()
    os.kill(os.getpid(), signal.SIGSEGV)


def fail(out: IO[bytes]) -> None:
    raise ValueError(out)


def sleep(out: IO[bytes]) -> None:
    time.sleep(60)


def take_memory(out: IO[bytes]) -> None:
    out.write(bytes(2 * MEMORY))


@pytest.fixture(autouse=True)
def _found_by_the_child(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    for function in (answer, crash, fail, sleep, take_memory):
        monkeypatch.setattr(function, "__module__", "test_child_process")


def test_the_answer_arrives() -> None:
    with output_of_child(answer, "Fähre", seconds=SECONDS, memory=MEMORY) as sent:
        assert sent.read().decode() == "Fähre"


@pytest.mark.parametrize(
    ("function", "seconds", "reason"),
    [(crash, SECONDS, "ended with SIGSEGV"), (fail, SECONDS, "failed"), (sleep, 1.0, "came to no end"),
     (take_memory, SECONDS, "took too much memory")],
)  # fmt: skip
def test_how_it_ended_is_told(function, seconds: float, reason: str) -> None:  # type: ignore[no-untyped-def]
    with (
        pytest.raises(ChildError, match=f"^reading it {reason}$"),
        output_of_child(function, seconds=seconds, memory=MEMORY) as sent,
    ):
        sent.read()


def test_an_answer_that_its_reader_finds_too_short_is_a_failure() -> None:
    with (
        pytest.raises(ChildError, match="^reading it failed$"),
        output_of_child(answer, "a", seconds=SECONDS, memory=MEMORY) as sent,
    ):
        sent.read()
        raise EOFError


def test_an_error_of_the_reader_ends_the_child_at_once() -> None:
    started = time.monotonic()
    with (
        pytest.raises(RuntimeError, match="enough"),
        output_of_child(sleep, seconds=SECONDS, memory=MEMORY),
    ):
        raise RuntimeError("enough")
    assert time.monotonic() - started < SECONDS / 2
