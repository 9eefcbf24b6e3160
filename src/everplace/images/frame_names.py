"""Which files of a directory are frames, and what is said of those that are not but could be taken for some."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterable

from everplace.files import readable
from everplace.images.decoding import is_image_name
from everplace.images.heif import HEIF_ENDINGS, require_heif

__all__ = ["choose_frames", "counted_endings", "unread_pictures"]

_UNREAD_PICTURES = (
    *(".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dng", ".erf", ".iiq", ".kdc", ".mrw", ".nef", ".nrw", ".orf", ".pef"),
    *(".raf", ".raw", ".rw2", ".rwl", ".sr2", ".srf", ".srw", ".x3f"),
    *(".apng", ".dds", ".dib", ".dpx", ".eps", ".exr", ".gif", ".hdr", ".heics", ".icns", ".ico", ".insp", ".j2c"),
    *(".j2k", ".jif", ".jp2", ".jpc", ".jpe", ".jpf", ".jpx", ".jxl", ".jxr", ".mpo", ".pam", ".pbm", ".pcx", ".pfm"),
    *(".pic", ".pnm", ".psd", ".qoi", ".ras", ".sgi", ".svg", ".tga", ".wdp", ".xbm", ".xcf", ".xpm"),
)
_RECORDINGS = (
    *(".3gp", ".avi", ".flv", ".h264", ".h265", ".hevc", ".insv", ".lrv", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4"),
    *(".mpeg", ".mpg", ".mts", ".seq", ".ts", ".webm", ".wmv"),
    *(".bag", ".bag.active", ".db3", ".mcap", ".mcap.zstd"),
)


def choose_frames(directory: str | os.PathLike[str], names: Iterable[str], *, recordings: bool = False) -> list[str]:
    """Returns the names of images, in the order given, and warns of pictures that are passed over.

    A phone writes IMG.HEIC beside IMG.JPG, the same picture: the JPG is taken then.

    Args:
        directory: Where they lie, for messages.
        names: Of files, or their paths from there.
        recordings: Warn of videos and bags, too.

    Raises:
        MissingExtraError: An image is HEIC or AVIF, which cannot be read here.
    """
    names = list(names)
    images = list(filter(is_image_name, names))
    if images and len(images) < len(names):
        unread = counted_endings(names, _UNREAD_PICTURES + (_RECORDINGS if recordings else ()))
        if unread:
            warnings.warn(
                f"{readable(directory)} holds pictures or recordings that are not read: {unread}; convert them, or "
                "move them away",
                stacklevel=1,
            )
    heif = [name for name in images if name.lower().endswith(HEIF_ENDINGS)]
    if not heif:
        return images
    stems = {name.rpartition(".")[0]: name for name in images if not name.lower().endswith(HEIF_ENDINGS)}
    doubles = {name for name in heif if name.rpartition(".")[0] in stems}
    if doubles:
        first = min(doubles)
        warnings.warn(
            f"{readable(directory)} holds {len(doubles)} pictures twice, such as {readable(first)} and "
            f"{readable(stems[first.rpartition('.')[0]])}; the HEIC or AVIF files were not read",
            stacklevel=1,
        )
    for name in heif:
        if name not in doubles:
            require_heif(readable(os.path.join(directory, name)), os.path.splitext(name)[1].lower())  # noqa: PTH118, PTH122
    return [name for name in images if name not in doubles]


def unread_pictures(names: Iterable[str]) -> str:
    """Returns the end of a sentence that says which known pictures lie where no image was found, or nothing."""
    unread = counted_endings(names, _UNREAD_PICTURES)
    return f"; it holds pictures that are not read ({unread}): convert them to PNG or JPEG" if unread else ""


def counted_endings(names: Iterable[str], endings: tuple[str, ...]) -> str:
    """Counts the names with some endings (lower case, beginning with a dot), as in `2 × .dng, 1 × .gif`."""
    found = (name.lower() for name in names if name.lower().endswith(endings))
    counts = Counter(next(ending for ending in endings if name.endswith(ending)) for name in found)
    return ", ".join(f"{count} × {ending}" for ending, count in sorted(counts.items()))
