"""Memory that stays: counted in page faults, which are the same on a busy machine."""

from __future__ import annotations

import ctypes
import resource
import sys
from pathlib import Path

import pytest

from everplace.training.freed_memory import freed_memory_kept

BLOCK = 64 * 2**20
glibc = pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "gnu_get_libc_version"), reason="needs glibc"
)


def faults_of_steps(steps: int = 8) -> int:
    """How often the system had to hand out a page while blocks were allocated, filled and freed in turn."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(steps):
        bytearray(b"x") * BLOCK
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def resident() -> int:
    """Bytes of memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


@glibc
def test_pages_are_handed_out_once() -> None:
    given_back = faults_of_steps()
    with freed_memory_kept():
        kept = faults_of_steps()
    assert kept < given_back / 4


@glibc
def test_afterwards_the_memory_is_given_back_even_when_training_failed() -> None:
    with pytest.raises(RuntimeError, match="diverged"), freed_memory_kept():
        faults_of_steps(1)
        kept = faults_of_steps()
        held = resident()
        raise RuntimeError("diverged")
    assert resident() < held - BLOCK / 2
    faults_of_steps(1)
    assert faults_of_steps() > 4 * max(kept, 1)


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
