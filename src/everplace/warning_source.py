"""Which file is being decoded, for the warnings of the libraries that decode it: they do not know its name."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar

__all__ = ["file_of_warning", "warnings_of"]

_FILE: ContextVar[str] = ContextVar("file", default="")


@contextlib.contextmanager
def warnings_of(name: str) -> Iterator[None]:
    """Says that warnings in this thread are about a file from here on, until the block ends."""
    token = _FILE.set(name)
    try:
        yield
    finally:
        _FILE.reset(token)


def file_of_warning() -> str:
    """Returns the name of the file that a warning of this moment is about; empty: none is being decoded."""
    return _FILE.get()
