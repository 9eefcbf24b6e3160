"""Keeps libtiff, which Pillow reads compressed TIFFs with, from writing to stderr."""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
from pathlib import Path

import PIL

__all__ = ["silence_libtiff"]

_HANDLERS = ("TIFFSetErrorHandler", "TIFFSetWarningHandler")


@functools.cache
def silence_libtiff() -> None:
    """Has libtiff say nothing: its lines name no file, and what is broken Pillow raises all the same."""
    bundled = sorted(Path(PIL.__file__).parent.parent.glob("pillow.libs/libtiff*.so*"))  # of Pillow's Linux wheels
    name = str(bundled[0]) if bundled else ctypes.util.find_library("tiff")
    if name is None:
        return
    library = ctypes.CDLL(name)
    for handler in _HANDLERS:
        setter = getattr(library, handler)
        setter.argtypes, setter.restype = [ctypes.c_void_p], ctypes.c_void_p
        setter(None)
