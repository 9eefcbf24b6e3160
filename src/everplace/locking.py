"""One writer at a time for a directory."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from everplace.errors import ConfigError, StorageError
from everplace.files import readable

if sys.platform != "win32":
    import fcntl

__all__ = ["locked"]

_SECONDS_TO_LET_GO = 10.0


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Keeps other processes from writing into a directory, which is made if missing.

    The system lets go of the lock when the process ends, however it ends. Windows has no such locks.

    Args:
        directory: What `--out` names.

    Raises:
        ConfigError: Another process writes into it.
        StorageError: The directory cannot be made.
    """
    if sys.platform == "win32":
        yield
        return
    try:
        directory.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(directory, os.O_RDONLY)
    except OSError as error:
        raise StorageError(f"cannot write {readable(directory)}: {error.strerror}; choose another place") from error
    try:
        _lock(descriptor, directory)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, directory: Path) -> None:
    # Processes that a run started share the lock, and outlive it by some seconds where it was killed.
    end = time.monotonic() + _SECONDS_TO_LET_GO
    while not _take(descriptor):
        if time.monotonic() >= end:
            raise ConfigError(
                f"--out {readable(directory)} is being written by another process; wait for it to end, or name another"
            )
        time.sleep(0.1)


def _take(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        # Not every file system has locks; a run must not depend on them.
        return True
    return True
