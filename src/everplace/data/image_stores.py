"""Images by name, whether they lie in a directory or in an archive."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Protocol

from everplace.data.archives import is_archive_name, list_members, read_members
from everplace.data.images import IMAGE_ENDINGS
from everplace.data.natural_order import natural_sorted
from everplace.data.sources.protocol import Content, Encoded
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["ArchiveStore", "FolderStore", "ImageStore", "files_below", "open_stores"]

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))
_DEEPEST = 8  # links can make a directory hold itself


class ImageStore(Protocol):
    """Images by name.

    Attributes:
        path: The directory or archive.
        names: Their names below it, parts separated by `/`, each once; hidden files are left out.
    """

    path: Path
    names: tuple[str, ...]

    def read(self, names: Collection[str]) -> Iterator[tuple[str, Content]]:
        """Reads the images of these names, in an order that suits the store.

        Raises:
            RouteError: One of them cannot be read.
        """
        ...


class FolderStore:
    """The images below a directory, eight levels deep; links are followed."""

    def __init__(self, path: Path) -> None:
        """Lists the directory.

        Raises:
            RouteError: It, or a directory below it, cannot be listed.
        """
        self.path = path
        self.names = tuple(files_below(path, _is_image, _DEEPEST))

    def read(self, names: Collection[str]) -> Iterator[tuple[str, Content]]:
        """Yields the paths of the files, which are not opened, in natural order."""
        for name in natural_sorted(names):
            yield name, self.path / name


class ArchiveStore:
    """The images in a tar or zip; see `archives`."""

    def __init__(self, path: Path) -> None:
        """Lists the archive, which reads a compressed one to its end.

        Raises:
            RouteError: It is damaged, dangerous, or holds a name twice.
        """
        self.path = path
        names: dict[str, None] = {}
        for member in list_members(path):
            if _is_image(member.name):
                if member.name in names:
                    raise RouteError(f"{readable(path)} holds {member.name!a} twice; pack it again")
                names[member.name] = None
        self.names = tuple(names)

    def read(self, names: Collection[str]) -> Iterator[tuple[str, Content]]:
        """Yields the files' contents, in the order of the archive, in one pass."""
        for name, data in read_members(self.path, names):
            yield name, Encoded(data, os.path.splitext(name)[1])  # noqa: PTH122


def open_stores(source: Path) -> list[ImageStore]:
    """Opens what holds a source's images: an archive, or a directory of images, of archives, or of both.

    Archives are looked for in the directory and in those below it, but not deeper.

    Raises:
        RouteError: It is none of these, or holds no image.
    """
    stores: list[ImageStore] = []
    if source.is_dir():
        archives = [source / name for name in files_below(source, is_archive_name, 1)]
        stores = [FolderStore(source), *map(ArchiveStore, archives)]
    elif is_archive_name(source.name):
        stores = [ArchiveStore(source)]
    else:
        raise RouteError(
            f"{readable(source)} is neither a directory nor a tar or zip archive; give the directory that holds it"
        )
    stores = [store for store in stores if store.names]
    if not stores:
        raise RouteError(
            f"{readable(source)} holds no image (a file that ends in {', '.join(_ENDINGS)}); check the path"
        )
    return stores


def _is_image(name: str) -> bool:
    hidden = name.startswith((".", "__MACOSX/")) or "/." in name
    return name.lower().endswith(_ENDINGS) and not hidden


def files_below(directory: Path, wanted: Callable[[str], bool], levels: int, prefix: str = "") -> Iterator[str]:
    """Yields the names of the files below a directory that are wanted, in natural order; hidden ones are left out.

    Args:
        directory: Where to look; links are followed.
        wanted: Says of a file's name whether it is.
        levels: How many levels of directories to look into below this one.
        prefix: What to put before each name.

    Raises:
        RouteError: A directory cannot be listed.
    """
    try:
        with os.scandir(directory) as entries:
            kinds = {entry.name: entry.is_dir() for entry in entries if not entry.name.startswith(".")}
    except OSError as error:
        raise RouteError(
            f"cannot list {readable(directory)}: {error.strerror or error}; check its permissions"
        ) from error
    for name in natural_sorted(kinds):
        if not kinds[name]:
            if wanted(name):
                yield prefix + name
        elif levels:
            yield from files_below(directory / name, wanted, levels - 1, f"{prefix}{name}/")
