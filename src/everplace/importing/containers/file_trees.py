"""Paths to other people's files, used like those of `pathlib`, whether a directory or an archive is behind."""

from __future__ import annotations

import os
import posixpath
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import IO, Literal, NamedTuple, TypeAlias

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.importing.foreign_route import Content
from everplace.route.natural_order import natural_sorted

__all__ = ["AnyPath", "Children", "DiskPath", "TreePath", "files_below", "is_image_name"]

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))


class Children(NamedTuple):
    """What lies in a directory, in natural order; hidden files and directories are left out.

    Attributes:
        directories: Names of the directories.
        files: Names of the files.
    """

    directories: list[str]
    files: list[str]


class TreePath(os.PathLike[str]):
    """A file or directory on the disk or in an archive, which need not exist.

    As text it is for messages: what is inside an archive lies below the archive's path.

    Attributes:
        source: The directory or archive that the user gave, or that was found there.
        is_on_disk: Whether it is, or would be, a file or directory of its own.
    """

    source: Path
    is_on_disk: bool

    @abstractmethod
    def __truediv__(self, name: str) -> TreePath:
        """Returns the path of what lies below, parts separated by `/`; an absolute name is one on the disk."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The last part of the path; of an archive what it would be unpacked into."""

    @property
    @abstractmethod
    def parent(self) -> TreePath:
        """What it lies in; the top of an archive lies in itself, as the top of a disk does."""

    @abstractmethod
    def is_dir(self) -> bool:
        """Says whether it is a directory."""

    @abstractmethod
    def is_file(self) -> bool:
        """Says whether it is a file."""

    @abstractmethod
    def children(self) -> Children:
        """Lists what lies in it.

        Raises:
            RouteError: It cannot be listed.
        """

    @abstractmethod
    def files(self) -> Iterator[str]:
        """Yields the files below it, at any depth, by their names from here; hidden ones are left out.

        Raises:
            RouteError: A directory cannot be listed.
        """

    @abstractmethod
    def open(self, mode: Literal["rb"] = "rb") -> IO[bytes]:
        """Opens the file, such as a list or a table.

        Raises:
            OSError: It is missing or cannot be read.
            RouteError: It lies in an archive and is too large to be held in memory, or two archives hold it.
        """

    @abstractmethod
    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Reads many files below it, each with its name, in an order that suits where they lie.

        Raises:
            RouteError: One of them cannot be read, or two archives hold it.
        """

    @cached_property
    def images(self) -> tuple[str, ...]:
        """The images below it, at any depth, by their names from here; errors as `files`."""
        return tuple(filter(is_image_name, self.files()))


AnyPath: TypeAlias = Path | TreePath
"""A file that can be opened for reading."""


class DiskPath(TreePath):
    """A file or directory on the disk; links are followed, and each directory is entered once."""

    is_on_disk = True

    def __init__(self, path: Path) -> None:
        self.source = self._path = path

    def __fspath__(self) -> str:
        return str(self._path)

    def __truediv__(self, name: str) -> DiskPath:
        return DiskPath(self._path / name)

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self._path.absolute().name

    @property
    def parent(self) -> DiskPath:
        """What it lies in."""
        return DiskPath(self._path.absolute().parent)

    def is_dir(self) -> bool:
        """Says whether it is a directory."""
        return os.path.isdir(self._path)  # noqa: PTH112 - also for names that no file system takes

    def is_file(self) -> bool:
        """Says whether it is a file."""
        return os.path.isfile(self._path)  # noqa: PTH113

    def children(self) -> Children:
        """Lists what lies in it."""
        at = self._path
        kinds: dict[str, bool] = {}
        try:
            with os.scandir(self._path) as entries:
                for entry in entries:
                    if not entry.name.startswith("."):
                        at = self._path / entry.name
                        kinds[entry.name] = entry.is_dir()
        except OSError as error:
            if at.is_symlink():
                raise RouteError(
                    f"cannot follow the link {readable(at)}: {error.strerror or error}; remove it or mend it"
                ) from error
            raise RouteError(
                f"cannot list {readable(self)}: {error.strerror or error}; check the path and its permissions"
            ) from error
        ordered = natural_sorted(kinds)
        return Children([name for name in ordered if kinds[name]], [name for name in ordered if not kinds[name]])

    def files(self) -> Iterator[str]:
        """Yields the files below it; those of a directory before those of the directories in it."""
        entered: set[tuple[int, int]] = set()
        waiting = [""]
        while waiting:
            below = waiting.pop()
            inside = (self / below).children()
            status = (self._path / below).stat()
            if (status.st_dev, status.st_ino) not in entered:
                entered.add((status.st_dev, status.st_ino))
                yield from (posixpath.join(below, file) for file in inside.files)
                waiting += [posixpath.join(below, directory) for directory in reversed(inside.directories)]

    def open(self, mode: Literal["rb"] = "rb") -> IO[bytes]:
        """Opens the file."""
        return self._path.open(mode)

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Yields the paths of files, which are not opened, in the order given."""
        return ((name, self._path / name) for name in names)


def files_below(directory: Path, wanted: Callable[[str], bool], levels: int) -> Iterator[str]:
    """Yields the names of the files below a directory that are wanted, in natural order; hidden ones are left out.

    Args:
        directory: Where to look; links are followed.
        wanted: Says of a file's name whether it is.
        levels: How many levels of directories to look into below this one.

    Raises:
        RouteError: A directory cannot be listed.
    """
    directories, files = DiskPath(directory).children()
    yield from filter(wanted, files)
    if levels:
        for below in directories:
            yield from (f"{below}/{name}" for name in files_below(directory / below, wanted, levels - 1))


def is_image_name(name: str) -> bool:
    """Says whether a file's name ends as an image's does, in capitals or not."""
    return name.lower().endswith(_ENDINGS)
