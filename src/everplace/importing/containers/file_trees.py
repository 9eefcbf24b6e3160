"""Other people's files by paths like those of `pathlib`, and images below them; `archive_tree` is for archives."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import IO, NamedTuple, TypeVar

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.images.frame_names import choose_frames, unread_pictures
from everplace.importing.foreign_route import Content, ForeignFrame
from everplace.route.folder import list_directory
from everplace.route.natural_order import natural_key, natural_sorted
from everplace.route.spelling import spelling_hint

__all__ = [
    "Children",
    "TreePath",
    "by_stem",
    "files_below",
    "image_names",
    "read_files",
    "read_frames",
    "stem_of",
]

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))
_Item = TypeVar("_Item")


class Children(NamedTuple):
    """What lies in a directory, in natural order; hidden files and directories are left out.

    Attributes:
        directories: Names of the directories.
        files: Names of the files.
    """

    directories: list[str]
    files: list[str]


class TreePath(os.PathLike[str]):
    """A file or directory on the disk, which need not exist; a subclass is one in an archive.

    As text it is for messages: what is inside an archive lies below the archive's path.

    Attributes:
        source: The path on the disk, or of the archive.
        is_on_disk: Whether it is, or would be, a file or directory of its own.
    """

    is_on_disk = True

    def __init__(self, path: Path) -> None:
        self.source = path

    def __fspath__(self) -> str:
        return str(self.source)

    def __truediv__(self, name: str) -> TreePath:
        """Returns the path of what lies below, parts separated by `/`; an absolute name is one on the disk."""
        return TreePath(self.source / name)

    @property
    def name(self) -> str:
        """The last part of the path; of an archive what it would be unpacked into."""
        return self.source.absolute().name

    @property
    def parent(self) -> TreePath:
        """What it lies in; the top of an archive lies in itself, as the top of a disk does."""
        return TreePath(self.source.absolute().parent)

    def is_dir(self) -> bool:
        """Says whether it is a directory."""
        return os.path.isdir(self.source)  # noqa: PTH112 - also for names that no file system takes

    def is_file(self) -> bool:
        """Says whether it is a file."""
        return os.path.isfile(self.source)  # noqa: PTH113

    def children(self) -> Children:
        """Lists what lies in it.

        Raises:
            RouteError: It cannot be listed.
        """
        return Children(*map(natural_sorted, list_directory(self.source)))

    def files(self) -> Iterator[str]:
        """Yields the files below it, at any depth, by their names from here; hidden ones are left out.

        Links are followed, and each directory is entered once. Those of a directory come before those of the
        directories in it; those of an archive as they come.

        Raises:
            RouteError: A directory cannot be listed.
        """
        entered: set[tuple[int, int]] = set()
        waiting = [""]
        while waiting:
            below = waiting.pop()
            inside = (self / below).children()
            status = (self.source / below).stat()
            if (status.st_dev, status.st_ino) not in entered:
                entered.add((status.st_dev, status.st_ino))
                yield from (posixpath.join(below, file) for file in inside.files)
                waiting += [posixpath.join(below, directory) for directory in reversed(inside.directories)]

    @cached_property
    def images(self) -> tuple[str, ...]:
        """The images below it, at any depth, by their names from here (see `choose_frames`); errors as `files`."""
        return tuple(choose_frames(self, self.files()))

    def open(self) -> IO[bytes]:
        """Opens the file, such as a list or a table.

        Raises:
            RouteError: It is missing or cannot be read, or lies in an archive and is too large to be held in memory, or
                two archives hold it.
        """
        try:
            return self.source.open("rb")
        except OSError as error:
            raise RouteError(
                f"cannot read {readable(self)}: {error.strerror or error}; check that the data set is whole"
            ) from error

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Yields many files below it, each with its name, in an order that suits where they lie.

        Raises:
            RouteError: One of them cannot be read, or two archives hold it.
        """
        return ((name, self.source / name) for name in names)


def files_below(directory: Path, wanted: Callable[[str], bool], levels: int) -> Iterator[str]:
    """Yields the names of the files below a directory that are wanted, in natural order; hidden ones are left out.

    Args:
        directory: Where to look; links are followed.
        wanted: Says of a file's name whether it is.
        levels: How many levels of directories to look into below this one.

    Raises:
        RouteError: A directory cannot be listed.
    """
    directories, files = TreePath(directory).children()
    yield from filter(wanted, files)
    if levels:
        for below in directories:
            yield from (f"{below}/{name}" for name in files_below(directory / below, wanted, levels - 1))


def image_names(directory: TreePath) -> list[str]:
    """Lists the images in a directory and its sub-directories; hidden ones are left out, no image is opened.

    Args:
        directory: Where to look. Links to directories are followed, each directory is entered once.

    Returns:
        Paths from `directory` with `/`, in natural order of the stems they get.

    Raises:
        RouteError: The directory does not exist, cannot be listed, holds no image, or a name that is not UTF-8.
    """
    if not directory.is_dir():
        problem = "is not a directory" if directory.is_file() else "does not exist"
        raise RouteError(f"{readable(directory)} {problem}; give the directory of the data set, or its archive")
    if not directory.images:
        raise RouteError(
            f"{readable(directory)} holds no file that ends in {', '.join(_ENDINGS)}"
            f"{unread_pictures(directory.files())}; put the images there"
        )
    try:
        "".join(directory.images).encode("utf-8")
    except UnicodeEncodeError as error:
        foreign = min(name for name in directory.images if any("\udc80" <= letter <= "\udcff" for letter in name))
        raise RouteError(f"the name of {readable(directory / foreign)} is not UTF-8; rename it") from error
    return sorted(directory.images, key=lambda name: natural_key(stem_of(name)))


def stem_of(name: str) -> str:
    """Returns the stem of an image in a route: its path without the ending, `night/7.jpg` as `night-7`."""
    folder, slash, last = name.rpartition("/")
    stem = last.rpartition(".")[0] or last
    return (folder + slash + stem).replace("/", "-").lstrip(".") or "-"


def by_stem(directory: TreePath, names: Iterable[str], prefix: str = "") -> dict[str, str]:
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


def read_files(directory: TreePath, names: Mapping[str, _Item], where: str = "") -> Iterator[tuple[_Item, Content]]:
    """Reads files, in an order that suits where they lie.

    Args:
        directory: Where they are.
        names: What each of them is, by path from there.
        where: The list that names them, for the message; empty: they are known to be there.

    Yields:
        What a file is, and its content.

    Raises:
        RouteError: There is no such file, or it cannot be read.
    """

    def there() -> Iterator[str]:
        for name in names:
            if where and not (directory / name).is_file():
                path = directory / name
                beside = path.parent.children().files if path.parent.is_dir() else []
                raise RouteError(
                    f"{readable(path)} does not exist, but {where} names it; complete the data set or correct the list"
                    f"{spelling_hint([path.name], beside)}"
                )
            yield name

    for name, content in directory.read(there()):
        yield names[name], content


def read_frames(directory: TreePath, names: Mapping[str, str], where: str = "") -> Iterator[ForeignFrame]:
    """Reads the frames of which nothing is known but their stems, as `read_files`.

    Args:
        directory: Where they are.
        names: Paths from there, by stem.
        where: The list that names them, for the message; empty: they are known to be there.
    """
    stems = {name: stem for stem, name in names.items()}
    return (ForeignFrame(stem, content) for stem, content in read_files(directory, stems, where))
