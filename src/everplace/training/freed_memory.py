"""Keeps the C library from giving memory back between two training steps.

Every step allocates and frees the same tensors. glibc gives blocks above 32 MiB back to the system as soon as they are
free, and the system then hands out every page anew, zeroed: at 224×224, in batches of 64, that is a third of the
processor time of a training (`python -m benchmarks training`). Of torch's own allocators only those of accelerators
keep what is freed.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator

from everplace.model.inference import default_device

__all__ = ["freed_memory_kept"]

# Parameters of mallopt(3).
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD, _MMAP_MAX = -1, -2, -3, -4
_MIB = 2**20
_KEPT = {_MMAP_MAX: 0, _TRIM_THRESHOLD: -1, _TOP_PAD: 64 * _MIB}
# Where glibc itself arrives once a large block was freed.
_USUAL = {_MMAP_MAX: 65536, _MMAP_THRESHOLD: 32 * _MIB, _TRIM_THRESHOLD: 64 * _MIB, _TOP_PAD: 128 * 2**10}


@contextlib.contextmanager
def freed_memory_kept() -> Iterator[None]:
    """While it is open, freed memory stays with the process; afterwards it goes back to the system.

    Does nothing where the C library is another than glibc, and where torch computes on a CUDA device, whose memory it
    keeps itself.
    """
    library = _glibc() if default_device().type == "cpu" else None
    if library is None:
        yield
        return
    try:
        _set(library, _KEPT)
        yield
    finally:
        _set(library, _USUAL)
        library.malloc_trim(0)


def _glibc() -> ctypes.CDLL | None:
    try:
        library = ctypes.CDLL(None)
        _ = library.gnu_get_libc_version, library.mallopt, library.malloc_trim
    except (OSError, TypeError, AttributeError):
        return None
    library.malloc_trim.argtypes = [ctypes.c_size_t]
    return library


def _set(library: ctypes.CDLL, parameters: dict[int, int]) -> None:
    for parameter, value in parameters.items():
        library.mallopt(parameter, value)
