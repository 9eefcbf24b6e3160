"""Temporary files and directories that a killed process left, told from those that one is writing."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import secrets
import shutil
import sys
import time
from pathlib import Path

__all__ = ["LEFTOVER", "sweep", "temporary_token"]

LEFTOVER = re.compile(r"\..+\.([0-9]+)-([0-9a-f]{8})\.part(\.[^.]*)?", re.DOTALL)
"""A temporary name: what it is to become, the process, and its machine with a random number."""

_SECONDS_UNTIL_LEFT = 86400.0
_SWEPT: set[tuple[int, str]] = set()


def temporary_token() -> str:
    """A part of a temporary name that says which process of which machine writes there."""
    return f"{os.getpid()}-{_machine()}{secrets.token_hex(2)}"


def _machine() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:4]


def sweep(directory: Path) -> None:
    """Removes what processes that are gone have left in a directory, once a process; the others' work stays."""
    key = (os.getpid(), os.path.realpath(directory))
    if key in _SWEPT:
        return
    _SWEPT.add(key)
    with contextlib.suppress(OSError):  # what cannot be removed hinders nobody
        for path in sorted(directory.glob(".*.part*")):
            found = LEFTOVER.fullmatch(path.name)
            if found is not None and _is_left(path, int(found[1]), found[2][:4]):
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path, ignore_errors=True)
                else:
                    path.unlink(missing_ok=True)


def _is_left(path: Path, process: int, machine: str) -> bool:
    """Whether nobody writes at a temporary path: its process is gone, or nothing has changed for a day."""
    if machine == _machine() and not _lives(process):
        return True
    changed = max(one.lstat().st_mtime for one in (path, *(path.iterdir() if path.is_dir() else ())))
    return bool(time.time() - changed > _SECONDS_UNTIL_LEFT)


def _lives(process: int) -> bool:
    if sys.platform == "win32":  # there the question would end it
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is another user's
        pass
    return True
