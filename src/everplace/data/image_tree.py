"""Image files below a directory, and the stems that they get in a route."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from everplace.data.images import IMAGE_ENDINGS
from everplace.data.natural_order import natural_key
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["by_stem", "image_names", "image_path", "stem_of"]

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))


def image_names(directory: Path) -> list[str]:
    """Lists the images in a directory and its sub-directories; hidden ones are left out, no image is opened.

    Args:
        directory: Where to look. Links to directories are followed, each directory is entered once.

    Returns:
        Paths from `directory` with `/`, in natural order of the stems they get.

    Raises:
        RouteError: The directory does not exist, cannot be listed, holds no image, or a name that is not UTF-8.
    """
    if not directory.is_dir():
        problem = "is not a directory" if directory.exists() else "does not exist"
        raise RouteError(f"{readable(directory)} {problem}; give the directory of the data set as it was unpacked")
    names = [name for name in _walk(directory, "", set()) if name.lower().endswith(_ENDINGS)]
    if not names:
        raise RouteError(
            f"{readable(directory)} holds no file that ends in {', '.join(_ENDINGS)}; unpack the images there"
        )
    try:
        "".join(names).encode("utf-8")
    except UnicodeEncodeError as error:
        foreign = min(name for name in names if any("\udc80" <= letter <= "\udcff" for letter in name))
        raise RouteError(f"the name of {readable(directory / foreign)} is not UTF-8; rename it") from error
    return sorted(names, key=lambda name: natural_key(stem_of(name)))


def stem_of(name: str) -> str:
    """Returns the stem of an image in a route: its path without the ending, `night/7.jpg` as `night-7`."""
    folder, slash, last = name.rpartition("/")
    stem = last.rpartition(".")[0] or last
    return (folder + slash + stem).replace("/", "-").lstrip(".") or "-"


def by_stem(directory: Path, names: Iterable[str], prefix: str = "") -> dict[str, str]:
    """Returns the names by the stems they get, in the order given.

    Args:
        directory: Where the images are, for the message.
        names: Paths from there.
        prefix: Put before each stem.

    Raises:
        RouteError: Two names get the same stem.
    """
    found: dict[str, str] = {}
    for name in names:
        stem = prefix + stem_of(name)
        if found.setdefault(stem, name) != name:
            raise RouteError(
                f"{found[stem]!r} and {name!r} in {readable(directory)} would both be the frame {stem!r}; keep one of "
                "them, or rename it"
            )
    return found


def image_path(directory: Path, name: str, where: str) -> Path:
    """Returns the file of an image that a list names.

    Raises:
        RouteError: There is no such file.
    """
    path = directory / name
    try:
        there = path.is_file()
    except (OSError, ValueError):  # a name that is too long, or that no file system takes
        there = False
    if not there:
        raise RouteError(
            f"{readable(path)} does not exist, but {where} names it; complete the data set or correct the list"
        )
    return path


def _walk(directory: Path, prefix: str, entered: set[tuple[int, int]]) -> Iterator[str]:
    try:
        status = directory.stat()
        if (status.st_dev, status.st_ino) in entered:
            return
        entered.add((status.st_dev, status.st_ino))
        with os.scandir(directory) as entries:
            found = sorted(((entry.name, entry.is_dir()) for entry in entries), key=lambda pair: natural_key(pair[0]))
    except OSError as error:
        raise RouteError(
            f"cannot list {readable(directory)}: {error.strerror or error}; check its permissions"
        ) from error
    for name, is_directory in found:
        if name.startswith("."):
            continue
        if is_directory:
            yield from _walk(directory / name, f"{prefix}{name}/", entered)
        else:
            yield prefix + name
