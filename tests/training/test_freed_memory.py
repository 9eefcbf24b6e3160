"""Memory that stays: counted in page faults, which are the same on a busy machine.

Counted in processes of their own: in the heap of one that has run other tests may lie a gap as large as a block, which
then is neither handed out anew nor given back.
"""

from __future__ import annotations

import ctypes
import json
import subprocess
import sys

import pytest

from everplace.training.freed_memory import freed_memory_kept

BLOCK = 64 * 2**20
glibc = pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "gnu_get_libc_version"), reason="needs glibc"
)

COUNTING = f"""
import json, resource
from pathlib import Path
from everplace.training.freed_memory import freed_memory_kept

def faults_of_steps(block, steps=8):
    # How often the system had to hand out a page while blocks were allocated, filled and freed in turn.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(steps):
        bytearray(b"x") * block
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

BLOCK = {BLOCK}
"""


def counted(script: str) -> dict[str, int]:
    """Runs a script that prints what it counted, as JSON, in a process of its own."""
    ran = subprocess.run([sys.executable, "-c", COUNTING + script], capture_output=True, text=True, check=True)
    found: dict[str, int] = json.loads(ran.stdout)
    return found


@glibc
def test_pages_are_handed_out_once() -> None:
    faults = counted("""
given_back = faults_of_steps(BLOCK)
with freed_memory_kept():
    kept = faults_of_steps(BLOCK)
print(json.dumps({"given back": given_back, "kept": kept}))
""")
    assert faults["kept"] < faults["given back"] / 4


@glibc
def test_afterwards_the_memory_is_given_back_even_when_training_failed() -> None:
    # Afterwards the blocks are larger than any gap that was left behind.
    found = counted("""
try:
    with freed_memory_kept():
        faults_of_steps(BLOCK, 1)
        kept = faults_of_steps(BLOCK)
        held = resident()
        raise RuntimeError("diverged")
except RuntimeError:
    left = resident()
faults_of_steps(2 * BLOCK, 1)
print(json.dumps({"kept": kept, "held": held, "left": left, "afterwards": faults_of_steps(2 * BLOCK)}))
""")
    assert found["left"] < found["held"] - BLOCK / 2
    assert found["afterwards"] > 4 * max(found["kept"], 1)


class _Musl:
    """A C library without glibc's functions, but with one of the same name that would be called wrongly."""

    def mallopt(self, *_: int) -> None:
        raise AssertionError("only glibc's parameters are known")


@pytest.mark.parametrize("library", [_Musl(), OSError("no such library"), TypeError("Windows wants a name")])
def test_another_c_library_is_left_alone(monkeypatch: pytest.MonkeyPatch, library: object) -> None:
    def opened(name: object) -> object:
        assert name is None
        if isinstance(library, Exception):
            raise library
        return library

    monkeypatch.setattr(ctypes, "CDLL", opened)
    entered = False
    with freed_memory_kept():
        entered = True
    assert entered
