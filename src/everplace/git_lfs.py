"""Pointers of Git LFS: small texts that lie where a repository's large files belong until they are fetched."""

from __future__ import annotations

from pathlib import Path

from everplace.errors import EverplaceError
from everplace.files import readable

__all__ = ["POINTER_BYTES", "is_pointer", "pointer_sentence", "refuse_pointer"]

_START = b"version https://git-lfs.github.com/spec/v1"

POINTER_BYTES = len(_START)
"""How much of a file's start `is_pointer` needs."""


def is_pointer(start: bytes) -> bool:
    """Says of the start of a file whether it is a pointer."""
    return start.startswith(_START)


def pointer_sentence(name: str) -> str:
    """Returns what to say of a pointer."""
    return f"{name} is a Git LFS pointer and not the file itself; run `git lfs pull` in the repository that it is from"


def refuse_pointer(path: Path, error: type[EverplaceError]) -> None:
    """Raises an error if a file is a pointer; what cannot be read is left to whoever reads it."""
    try:
        if not path.is_file():  # a device or FIFO would be waited for
            return
        with path.open("rb") as file:
            start = file.read(POINTER_BYTES)
    except OSError:
        return
    if is_pointer(start):
        raise error(pointer_sentence(readable(path)))
