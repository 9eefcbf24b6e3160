"""The beginning of a file that is being downloaded, kept on disk beside its target.

The bytes are in `.NAME.download`; `.NAME.download.json` says which version of which URL they are the beginning of.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import BinaryIO

from everplace.errors import StorageError
from everplace.files import readable, write_text

if sys.platform != "win32":
    import fcntl

__all__ = ["About", "Partial", "partial_file"]


@dataclass(frozen=True)
class About:
    """Which version of which file a partial download is the beginning of.

    Attributes:
        url: Where it comes from.
        validator: What tells this version from another, as the server says; empty: it says nothing.
        total: Bytes of the whole file; None: the server did not say.
    """

    url: str = ""
    validator: str = ""
    total: int | None = None


class Partial:
    """An open partial file that this process has locked.

    Attributes:
        target: What it is to become.
        about: What it is the beginning of.
    """

    def __init__(self, target: Path, file: BinaryIO) -> None:
        self.target = target
        self._file = file
        self._about_path = _path(target).with_name(f"{_path(target).name}.json")
        self.about = _read_about(self._about_path)

    @property
    def size(self) -> int:
        """Bytes that have come."""
        return os.fstat(self._file.fileno()).st_size

    @property
    def path(self) -> Path:
        """Where the bytes are."""
        return _path(self.target)

    def restart(self, about: About) -> None:
        """Forgets what has come; the bytes go first, so that they never stand beside another's description."""
        self._file.truncate(0)
        write_text(self._about_path, json.dumps(asdict(about)))
        self.about = about

    def append(self, data: bytes) -> None:
        """Adds bytes at the end."""
        left = memoryview(data)
        while left:  # an unbuffered file takes what it can
            left = left[self._file.write(left) :]

    def finish(self) -> None:
        """Makes it the target."""
        os.fsync(self._file.fileno())
        self.path.replace(self.target)
        self._about_path.unlink(missing_ok=True)

    def drop(self) -> None:
        """Removes it."""
        self.path.unlink(missing_ok=True)
        self._about_path.unlink(missing_ok=True)


@contextlib.contextmanager
def partial_file(target: Path) -> Iterator[Partial]:
    """Opens the partial file of a target; while another process downloads it, this one waits.

    Raises:
        StorageError: It cannot be written to.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        while True:
            # Unbuffered: what was written is there after a kill.
            with _path(target).open("ab", buffering=0) as file:
                if sys.platform != "win32":
                    fcntl.flock(file, fcntl.LOCK_EX)
                # Otherwise whoever held the lock has finished or removed this very file.
                if _is_at(file, _path(target)):
                    yield Partial(target, file)
                    return
    except OSError as error:
        raise StorageError(
            f"cannot write {readable(target)}: {error.strerror or error}; free space or choose another place"
        ) from error


def _path(target: Path) -> Path:
    return target.with_name(f".{target.name}.download")


def _is_at(file: BinaryIO, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _read_about(path: Path) -> About:
    """Reads what is known of the bytes; nothing where it was never written or is damaged."""
    try:
        about = About(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return About()
    known = isinstance(about.url, str) and isinstance(about.validator, str) and isinstance(about.total, int | None)
    return about if known else About()
