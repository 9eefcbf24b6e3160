"""Reading regular files alone: a device, a FIFO or a socket would be waited for, or has no end."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path
from typing import BinaryIO, TextIO

__all__ = ["open_regular_text", "read_regular"]

_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0)


def open_regular_text(path: Path) -> TextIO:
    """Opens a UTF-8 file for reading, with or without a mark, its line ends as they are; see `read_regular`."""
    return io.TextIOWrapper(_open_regular(path), "utf-8-sig", newline="")


def read_regular(path: Path) -> bytes:
    """Reads a file, but no device, FIFO or socket: these would be waited for, or have no end.

    Raises:
        OSError: It is one of these, or cannot be read.
    """
    with _open_regular(path) as file:
        return file.read()


def _open_regular(path: Path) -> BinaryIO:
    # Path.open has no opener.
    file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | _WITHOUT_WAITING))  # noqa: SIM115
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a device, a FIFO or a socket, not a regular file", str(path))
    return file
