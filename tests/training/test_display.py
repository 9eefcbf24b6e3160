"""What a person sees while a run trains: a terminal of any width shows the epoch, the bar and the time left."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import termios
import threading

import pytest
from tests.forked import ForkedProcess

SHOWN = """
import time
from everplace.training.display import TrainingDisplay

with TrainingDisplay(40, "cp-vae-best") as display:
    display.begin_epoch(0, 44)
    for _ in range(44):
        display.advance()
    display.end_epoch({"epoch": 1.0, "seconds": 3.0, "bound": -35123.4, "image": -34012.7, "place": -6.1234,
        "condition": -0.6931, "kl_place": 12.3456, "kl_condition": 1.2345, "active_place": 96.0,
        "active_condition": 32.0, "held_out_recall_at_1": 0.8765})
    display.begin_epoch(1, 44)
    for _ in range(22):
        display.advance()
        time.sleep(0.03)
"""


def seen_at(columns: int) -> str:
    """The last line that a terminal of so many columns shows."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    kept = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    read: list[bytes] = []

    def drain() -> None:
        try:
            while chunk := os.read(ours, 4096):
                read.append(chunk)
        except OSError:  # the other end is closed
            return

    reader = threading.Thread(target=drain)
    reader.start()
    process = ForkedProcess("-c", SHOWN, stderr=theirs, env={**kept, "TERM": "xterm"})
    assert process.wait(60) == 0
    os.close(theirs)
    reader.join(timeout=10)
    os.close(ours)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", b"".join(read).decode())
    return [line for line in re.split(r"[\r\n]+", text) if "epoch 2" in line][-1].rstrip()


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "terms"), [(60, 0), (80, 1), (120, 3), (200, 8)])
def test_epoch_bar_and_time_are_seen_at_any_width(columns: int, terms: int) -> None:
    line = seen_at(columns)
    assert line.startswith("cp-vae-best: epoch 2/40 ━")
    assert re.search(r" 22/44 [0-9]:[0-9]{2}:[0-9]{2}", line)
    assert len(line) <= columns
    shown = re.split("[0-9]:[0-9]{2}:[0-9]{2}", line)[1].split("  ")
    assert len([term for term in shown if term.strip()]) == terms
    assert "…" not in line
    if terms:
        assert "bound -3.512e+04" in line


@pytest.mark.slow
def test_more_columns_show_more_terms() -> None:
    assert "held-out recall@1 0.8765" in seen_at(260)
