"""Paths into trees of files, which are used like those of `pathlib`, whether a directory or an archive is behind."""

from __future__ import annotations

import contextlib
import posixpath
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal, NamedTuple, TypeAlias

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.archive_tree import ArchiveTree, archives_in, is_archive, unread_note
from everplace.importing.containers.archives import is_archive_name
from everplace.importing.containers.file_trees import Children, FileTree, FolderTree

__all__ = ["AnyPath", "Places", "TreePath", "find_data_set", "find_places"]

# A data set may lie in a directory of the archive, and that in another; KITTI's sequences lie two levels below.
_DEEPEST = 4


@dataclass(frozen=True, eq=False)
class TreePath:
    """A file or directory of a tree, which need not exist.

    Attributes:
        tree: Where it lies.
        inside: Its name there, parts separated by `/`; empty: the top.
    """

    tree: FileTree
    inside: str = ""

    @classmethod
    def of(cls, path: Path) -> TreePath:
        """Returns the path of a file or directory on the disk."""
        return cls(FolderTree(path))

    def __truediv__(self, name: str) -> TreePath:
        """Returns the path of what lies below; an absolute name is one on the disk."""
        path = Path(name)
        return TreePath.of(path) if path.is_absolute() else TreePath(self.tree, posixpath.join(self.inside, name))

    def __fspath__(self) -> str:
        """Returns a text for messages: what is inside an archive lies below the archive's path."""
        return str(self.tree.locate(self.inside))

    @property
    def name(self) -> str:
        """The last part of the path."""
        return posixpath.basename(self.inside) or self.tree.label

    @property
    def parent(self) -> TreePath:
        """What it lies in; the top of an archive lies in itself, as the top of a disk does."""
        if self.inside:
            return TreePath(self.tree, posixpath.dirname(self.inside))
        return TreePath.of(self.tree.path.absolute().parent) if self.is_on_disk else self

    @property
    def is_on_disk(self) -> bool:
        """Whether it is, or would be, a file or directory of its own, at the path that `os.fspath` gives."""
        return isinstance(self.tree, FolderTree)

    def is_dir(self) -> bool:
        """Says whether it is a directory."""
        return self.tree.is_dir(self.inside)

    def is_file(self) -> bool:
        """Says whether it is a file."""
        return self.tree.is_file(self.inside)

    def children(self) -> Children:
        """Lists what lies in it; errors as `FileTree.children`."""
        return self.tree.children(self.inside)

    def open(self, mode: Literal["rb"] = "rb") -> IO[bytes]:
        """Opens the file; errors as `FileTree.open`."""
        return self.tree.open(self.inside)


AnyPath: TypeAlias = Path | TreePath
"""A file on the disk or in a tree."""


class Places(NamedTuple):
    """What was found in a source.

    Attributes:
        found: The directories, those nearest to the top first, each level in natural order.
        notes: Sentences that say what lies in the source and was not read.
    """

    found: list[TreePath]
    notes: list[str]


class _Search(NamedTuple):
    """What one tree holds: the wanted places, the archives outside them, and why a directory was not searched."""

    found: list[TreePath]
    archives: list[TreePath]
    closed: list[RouteError]


def find_places(source: Path, wanted: Callable[[TreePath], bool], *, apart: bool = False) -> Places:
    """Finds directories of a kind in what the user gave, down to the fourth level.

    Each branch is searched until one is found; what lies below that belongs to it. A directory on the disk is entered
    once, though links lead there too.

    Args:
        source: A directory or an archive.
        wanted: Says of a directory whether it is one.
        apart: Search each archive in a directory too, as a tree of its own. Otherwise the archives are searched only if
            nothing is found unpacked, all together, as if each were unpacked where it lies.

    Raises:
        RouteError: The source is neither, cannot be listed, or an archive is damaged or dangerous.
    """
    if not source.is_dir():
        if not is_archive_name(source.name):
            problem = "is neither a directory nor a tar or zip archive" if source.exists() else "does not exist"
            raise RouteError(f"{readable(source)} {problem}; give the data set's directory, or its archive")
        found, nested, _ = _search(ArchiveTree(source), wanted)
        return Places(found, unread_note(nested) if found else [])
    found, archives, closed = _search(FolderTree(source), wanted)
    notes = []
    unread = [archive for place in found for archive in _archives_below(place, closed)]
    if apart:
        for archive in archives:
            inside, nested, _ = _search(ArchiveTree(Path(archive)), wanted)
            if not inside:
                notes.append(f"{readable(archive)} holds no sequence.")
            found += inside
            unread += nested
    elif archives and not found:
        mounts = [(posixpath.dirname(archive.inside), Path(archive)) for archive in archives]
        found, nested, _ = _search(ArchiveTree(source, mounts), wanted)
        unread += nested
    else:
        unread += archives
    if closed and not found:
        raise closed[0]
    notes += [f"A directory was not searched: {error}." for error in closed]
    return Places(found, unread_note(unread) + notes)


def find_data_set(
    source: Path, wanted: Callable[[TreePath], bool], what: str, *, preferred: str = ""
) -> tuple[TreePath, list[str]]:
    """Finds the one data set in what the user gave; see `find_places`.

    Args:
        source: A directory or an archive.
        wanted: Says of a directory whether it holds the data set.
        what: What it must hold, for the message.
        preferred: The name of the directory that counts where there are several.

    Returns:
        Where it is, or the top of the source if it is nowhere; and sentences that say what was not read.

    Raises:
        RouteError: There are several, or as for `find_places`.
    """
    places = find_places(source, wanted)
    found = [place for place in places.found if place.name == preferred] or places.found
    if len(found) > 1:
        remedy = "give one of them" if found[0].is_on_disk else "unpack the archive and give one of them"
        raise RouteError(f"{readable(found[0])} and {readable(found[1])} both hold {what}; {remedy}")
    if found:
        return found[0], places.notes
    return TreePath(FolderTree(source) if source.is_dir() else ArchiveTree(source)), []


def _archives_below(place: TreePath, closed: list[RouteError]) -> list[TreePath]:
    """Returns the archives in a directory; if that fails, adds to `closed` why."""
    try:
        return [place / name for name in archives_in(Path(place))]
    except RouteError as error:
        closed.append(error)
        return []


def _search(tree: FileTree, wanted: Callable[[TreePath], bool]) -> _Search:
    result = _Search([], [], [])
    entered: set[tuple[int, int]] = set()
    level = [TreePath(tree)]
    for _ in range(_DEEPEST + 1):
        below = []
        for place in level:
            if place.is_on_disk:
                with contextlib.suppress(OSError):  # one that cannot be entered cannot be listed either
                    status = Path(place).stat()
                    if (status.st_dev, status.st_ino) in entered:
                        continue
                    entered.add((status.st_dev, status.st_ino))
            if wanted(place):
                result.found.append(place)
                continue
            try:
                directories, files = place.children()
            except RouteError as error:
                if not place.inside:
                    raise
                result.closed.append(error)
                continue
            result.archives.extend(place / name for name in files if is_archive(place / name))
            below += [place / name for name in directories]
        # A directory counts before a link to it.
        level = sorted(below, key=lambda place: place.is_on_disk and Path(place).is_symlink())
    return result
