"""Unpacking no more than a file's packed bytes can stand for, unless it is a picture of so many pixels."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import IO

from everplace.errors import ImageError, MissingExtraError
from everplace.images.decoding import BROKEN_IMAGE_ERRORS, MAX_PIXELS
from everplace.images.formats import announced_pixels, image_ending

__all__ = ["MOST_TIMES", "SmallSteps", "read_in_proportion"]

MOST_TIMES = 1000
"""How many times its packed size a file may unpack to."""

# A picture of one colour packs better still, and so does a short list.
_FREE = 2**20
_BYTES_A_PIXEL = 8  # four values of 16 bits
_CHUNK = 2**16
_STEP = 2**13


def read_in_proportion(file: IO[bytes], size: int, spent: Callable[[], int] | None) -> bytes | None:
    """Reads a file from inside an archive.

    Args:
        file: Where its bytes come from.
        size: How many there are, as the archive says.
        spent: Says how many packed bytes were taken for it so far; None: it is not packed.

    Returns:
        The bytes; None: they are more than `MOST_TIMES` times those taken, and no image of so many pixels.
    """
    content = io.BytesIO()  # whose value is no second copy
    while spent is not None and (chunk := file.read(_CHUNK)):
        content.write(chunk)
        if content.tell() > max(_FREE, MOST_TIMES * spent()):
            if image_ending(content.getvalue()) == ".tiff":  # its header may stand at its end
                content.write(file.read())
            if not _is_image_of(size, content.getvalue()):
                return None
            break
    if not content.tell():
        return file.read()
    content.write(file.read())
    return content.getvalue()


def _is_image_of(size: int, start: bytes) -> bool:
    """Says whether the pixels that an image's header announces may take so many bytes."""
    try:
        pixels = announced_pixels(start)
    except (ImageError, MissingExtraError, *BROKEN_IMAGE_ERRORS):
        return False
    return size <= _BYTES_A_PIXEL * min(pixels, MAX_PIXELS) + _FREE


class SmallSteps:
    """A packed file that gives few bytes at once, so that its place tells how many were unpacked."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def spent_since(self, start: int) -> int:
        """Returns how many bytes were taken since a place, less what may have been read ahead."""
        return max(2 * _STEP, self.tell() - start - _STEP)

    def read(self, size: int = -1) -> bytes:
        """Reads a step at most."""
        return self._file.read(_STEP if size < 0 else min(size, _STEP))

    def seek(self, offset: int, whence: int = 0) -> int:
        """Goes to another place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Returns the place."""
        return self._file.tell()

    def seekable(self) -> bool:
        """Says that other places can be gone to."""
        return True
