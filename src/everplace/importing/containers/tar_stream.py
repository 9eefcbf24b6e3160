"""What `tarfile` reads from: the decompressed bytes of a tar, forward only and within limits."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import tarfile
from typing import IO

__all__ = ["MAX_HEADER", "DisproportionError", "TarStream", "expansion_limit"]

MAX_HEADER = 2**20
"""Bytes that a header may have, with its long names and extended attributes."""

# Pictures hardly compress; a tar of a million tiny files does by its padding, but not a hundredfold.
_MOST_EXPANSION = 200
_FREE_EXPANSION = 2**30
_BLOCK = 512


class DisproportionError(Exception):
    """An archive decompresses to more than its size allows."""


def expansion_limit(compressed: int) -> int:
    """Returns to how many bytes an archive of a size may decompress."""
    return _FREE_EXPANSION + _MOST_EXPANSION * compressed


class TarStream(io.RawIOBase):
    """The bytes of a tar: forward only, and never more than the archive's size allows.

    A broken length field can point back, which `tarfile` would follow for ever.

    Attributes:
        most_at_once: Bytes that may be asked for at a time, so that a header that claims to be huge takes no memory.
    """

    def __init__(self, file: IO[bytes], compressed: int) -> None:
        """Begins to read a tar, also one compressed by gzip, bzip2 or xz: the content decides.

        Args:
            file: The archive, at its start.
            compressed: Its bytes.
        """
        self._source = _decompressed(file)
        self._position = 0
        self._most = expansion_limit(compressed)
        self._last_block = b""
        self.most_at_once = MAX_HEADER

    @property
    def ended_with_mark(self) -> bool:
        """Whether the last block that was read is the one of zeros that ends a tar."""
        return self._last_block == bytes(_BLOCK)

    def readable(self) -> bool:
        """Says that it is."""
        return True

    def seekable(self) -> bool:
        """Says that it is; only forward."""
        return True

    def tell(self) -> int:
        """Returns how many bytes were read or passed over."""
        return self._position

    def seek(self, offset: int, whence: int = 0) -> int:
        """Passes over what lies before a place."""
        if whence != 0 or offset < self._position:
            raise tarfile.ReadError("a member begins before the one that it follows")
        if self._source.seekable() and isinstance(self._source, io.BufferedReader):
            self._position = self._source.seek(offset)
        while self._position < offset and self.read(min(offset - self._position, MAX_HEADER)):
            pass
        return self._position

    def read(self, size: int = -1) -> bytes:
        """Reads so many bytes, or fewer at the end."""
        if size < 0 or size > self.most_at_once:
            raise tarfile.ReadError(f"a header of {size} bytes")
        if self._position + size > self._most:
            raise DisproportionError(f"decompresses out of all proportion, to more than {self._most} bytes")
        data = self._source.read(size)
        self._position += len(data)
        if size == _BLOCK:
            self._last_block = data
        return data

    def read_to_end(self) -> None:
        """Reads what follows the end mark: only there does a compressed file's checksum come."""
        while self.read(MAX_HEADER):
            pass


def _decompressed(file: IO[bytes]) -> IO[bytes]:
    start = file.read(6)
    file.seek(0)
    if start.startswith(b"\x1f\x8b"):
        return gzip.GzipFile(fileobj=file)  # type: ignore[return-value]
    if start.startswith(b"BZh"):
        return bz2.BZ2File(file)
    if start.startswith(b"\xfd7zXZ\0"):
        return lzma.LZMAFile(file)
    return file
