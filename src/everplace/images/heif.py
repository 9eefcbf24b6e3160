"""HEIC and AVIF, which phones write: read by pillow-heif, and AVIF by Pillow where it was built so (extra `heif`)."""

from __future__ import annotations

import importlib.util
import struct

from PIL import ImageFile

from everplace.errors import MissingExtraError

__all__ = ["HEIF_ENDINGS", "heif_ending", "heif_reader", "require_heif"]

HEIF_ENDINGS = (".avif", ".heic", ".heif", ".hif")
"""Endings (lower case) of these files; the content decides, and phones call the one like the other."""

_BRANDS = {
    **dict.fromkeys((b"avif", b"avis"), ".avif"),
    **dict.fromkeys((b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"), ".heic"),
}


def heif_ending(start: bytes) -> str:
    """Returns `.avif` or `.heic` for the first bytes of such a file; empty: it is another."""
    if start[4:8] != b"ftyp":
        return ""
    (length,) = struct.unpack_from(">I", start)
    brands = [start[at : at + 4] for at in (8, *range(16, min(length, len(start)), 4))]
    known = [_BRANDS[brand] for brand in brands if brand in _BRANDS]
    # A file that names the container first says further on what is in it.
    return ".avif" if ".avif" in known and brands[0] not in {b"heic", b"heix"} else next(iter(known), "")


def heif_reader(name: str, ending: str) -> type[ImageFile.ImageFile]:
    """Returns what reads such files.

    Args:
        name: What to call the file in messages.
        ending: What `heif_ending` says of it.

    Raises:
        MissingExtraError: Nothing does.
    """
    require_heif(name, ending)
    if ending == ".avif":
        from PIL.AvifImagePlugin import AvifImageFile

        return AvifImageFile
    from pillow_heif.as_plugin import HeifImageFile

    return HeifImageFile


def require_heif(name: str, ending: str) -> None:
    """Sees that files with such an ending can be read.

    Raises:
        MissingExtraError: They cannot.
    """
    if not (_reads_avif() if ending == ".avif" else importlib.util.find_spec("pillow_heif") is not None):
        raise MissingExtraError(f"reading {name}", "heif")


def _reads_avif() -> bool:
    try:
        from PIL.AvifImagePlugin import SUPPORTED
    except ImportError:  # Pillow before 11.3
        return False
    return bool(SUPPORTED)
