"""Trees of files to be read by name, and the one that is a directory; `archive_tree` is the one of archives."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import IO, NamedTuple, Protocol

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.importing.foreign_route import Content
from everplace.route.natural_order import natural_sorted

__all__ = ["Children", "FileTree", "FolderTree", "files_below", "is_image_name"]

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))


class Children(NamedTuple):
    """What lies in a directory, in natural order; hidden files and directories are left out.

    Attributes:
        directories: Names of the directories.
        files: Names of the files.
    """

    directories: list[str]
    files: list[str]


class FileTree(Protocol):
    """Files by name, to be read.

    A name is a path below the top, parts separated by `/`; the empty name is the top.

    Attributes:
        path: The directory or archive.
        label: What the top is called.
    """

    path: Path
    label: str

    @property
    def images(self) -> tuple[str, ...]:
        """The names of all images, each once; hidden files are left out.

        Raises:
            RouteError: A directory cannot be listed.
        """
        ...

    def locate(self, name: str) -> Path:
        """Returns where a file or directory is, or would be, for messages."""
        ...

    def is_dir(self, name: str) -> bool:
        """Says whether there is a directory of this name."""
        ...

    def is_file(self, name: str) -> bool:
        """Says whether there is a file of this name."""
        ...

    def children(self, name: str) -> Children:
        """Lists a directory; one that does not exist is an error or empty.

        Raises:
            RouteError: It cannot be listed.
        """
        ...

    def files(self, name: str) -> Iterator[str]:
        """Yields the files below a directory, at any depth, by their names below it; hidden ones are left out.

        Raises:
            RouteError: A directory cannot be listed.
        """
        ...

    def open(self, name: str) -> IO[bytes]:
        """Opens a file, such as a list or a table.

        Raises:
            OSError: It is missing or cannot be read.
            RouteError: It lies in an archive and is too large to be held in memory, or two archives hold it.
        """
        ...

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Reads many files, in an order that suits the tree.

        Raises:
            RouteError: One of them cannot be read, or two archives hold it.
        """
        ...


class FolderTree:
    """What lies below a directory; links are followed, and each directory is entered once."""

    def __init__(self, path: Path) -> None:
        """Opens a directory, which is not listed yet."""
        self.path = path
        self.label = path.absolute().name

    @cached_property
    def images(self) -> tuple[str, ...]:
        """The names of all images."""
        return tuple(filter(is_image_name, self.files("")))

    def locate(self, name: str) -> Path:
        """Returns the path of a file or directory."""
        return self.path / name

    def is_dir(self, name: str) -> bool:
        """Says whether there is a directory of this name."""
        return _holds((self.path / name).is_dir)

    def is_file(self, name: str) -> bool:
        """Says whether there is a file of this name."""
        return _holds((self.path / name).is_file)

    def children(self, name: str) -> Children:
        """Lists a directory."""
        directory = at = self.path / name
        kinds: dict[str, bool] = {}
        try:
            with os.scandir(directory) as entries:
                for entry in entries:
                    if not entry.name.startswith("."):
                        at = directory / entry.name
                        kinds[entry.name] = entry.is_dir()
        except OSError as error:
            if at.is_symlink():
                raise RouteError(
                    f"cannot follow the link {readable(at)}: {error.strerror or error}; remove it or mend it"
                ) from error
            raise RouteError(
                f"cannot list {readable(directory)}: {error.strerror or error}; check the path and its permissions"
            ) from error
        ordered = natural_sorted(kinds)
        return Children([name for name in ordered if kinds[name]], [name for name in ordered if not kinds[name]])

    def files(self, name: str) -> Iterator[str]:
        """Yields the files below a directory; those of a directory before those of the directories in it."""
        entered: set[tuple[int, int]] = set()
        waiting = [""]
        while waiting:
            below = waiting.pop()
            inside = self.children(posixpath.join(name, below))
            status = (self.path / name / below).stat()
            if (status.st_dev, status.st_ino) not in entered:
                entered.add((status.st_dev, status.st_ino))
                yield from (posixpath.join(below, file) for file in inside.files)
                waiting += [posixpath.join(below, directory) for directory in reversed(inside.directories)]

    def open(self, name: str) -> IO[bytes]:
        """Opens a file."""
        return (self.path / name).open("rb")

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Yields the paths of the files, which are not opened, in the order given."""
        for name in names:
            yield name, self.path / name


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
    directories, files = FolderTree(directory).children("")
    yield from (prefix + name for name in files if wanted(name))
    if levels:
        for name in directories:
            yield from files_below(directory / name, wanted, levels - 1, f"{prefix}{name}/")


def is_image_name(name: str) -> bool:
    """Says whether a file's name ends as an image's does, in capitals or not."""
    return name.lower().endswith(_ENDINGS)


def _holds(question: Callable[[], bool]) -> bool:
    """Answers no for a name that is too long, or that no file system takes."""
    try:
        return question()
    except (OSError, ValueError):
        return False
