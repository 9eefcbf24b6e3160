"""One writer at a time, for a directory or a file."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from everplace.errors import ConfigError, StorageError
from everplace.files import readable

__all__ = ["locked", "waiting_turn"]

_SECONDS_TO_LET_GO = 10.0
_WITHOUT_LOCKS = frozenset({errno.ENOLCK, errno.EOPNOTSUPP})


@contextlib.contextmanager
def locked(directory: Path, what: str = "`out` ") -> Iterator[None]:
    """Keeps other processes from writing into a directory, which is made if missing.

    The lock is the file `.lock` in it, which is removed at the end. The system lets go of it when the process ends,
    however it ends.

    Args:
        directory: What is written into.
        what: What the message calls it.

    Raises:
        ConfigError: Another process writes into it.
        StorageError: The directory cannot be made or written to.
    """
    # Processes that a run started share the lock, and outlive it by some seconds where it was killed.
    with _holding(directory / ".lock", _SECONDS_TO_LET_GO, what):
        yield


@contextlib.contextmanager
def waiting_turn(target: Path) -> Iterator[None]:
    """Waits until no other process makes this file, and keeps others waiting meanwhile.

    Raises:
        StorageError: Its directory cannot be made or written to.
    """
    with _holding(target.with_name(f".{target.name}.lock"), -1):
        yield


@contextlib.contextmanager
def _holding(path: Path, seconds: float, what: str = "") -> Iterator[None]:
    lock = FileLock(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(seconds)
    except Timeout:
        raise ConfigError(
            f"{what}{readable(path.parent)} is being written by another process; wait for it to end, or name another"
        ) from None
    except OSError as error:
        # Not every file system has locks; a run must not depend on them.
        if error.errno not in _WITHOUT_LOCKS:
            raise StorageError(
                f"cannot write {readable(path.parent)}: {error.strerror}; choose another place"
            ) from error
    try:
        yield
    finally:
        # Before letting go: who waits for it notices and makes a new one. Windows removes it at its release.
        with contextlib.suppress(OSError):
            path.unlink()
        lock.release()
