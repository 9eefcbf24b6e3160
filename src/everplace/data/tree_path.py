"""Paths into trees of files, which are used like those of `pathlib`, whether a directory or an archive is behind."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Literal, TypeAlias

from everplace.data.archive_tree import ArchiveTree, archives_in
from everplace.data.archives import archive_label, is_archive_name
from everplace.data.file_trees import Children, FileTree, FolderTree
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["AnyPath", "TreePath", "find_data_set", "find_places"]

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
        return str(self.tree.path / self.inside)

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


def find_places(source: Path, wanted: Callable[[TreePath], bool], *, apart: bool = False) -> list[TreePath]:
    """Finds directories of a kind in what the user gave: itself, or those nearest below it.

    A directory is searched first as it is, then with the archives in it (see `archives_in`) as if they were unpacked.

    Args:
        source: A directory or an archive.
        wanted: Says of a directory whether it is one.
        apart: Unpack each archive of a directory into a directory of its own name, for archives whose names within
            are the same in all. Otherwise they lie where the archive lies.

    Returns:
        All at the level nearest to the top, in natural order; none: there is none down to the fourth level.

    Raises:
        RouteError: The source is neither, cannot be listed, or an archive is damaged or dangerous.
    """
    for tree in _trees(source, apart):
        level = [TreePath(tree)]
        for _ in range(_DEEPEST + 1):
            found = [place for place in level if wanted(place)]
            if found:
                return found
            level = [place / name for place in level for name in place.children().directories]
    return []


def find_data_set(source: Path, wanted: Callable[[TreePath], bool], what: str) -> TreePath:
    """Finds the one data set in what the user gave; see `find_places`.

    Args:
        source: A directory or an archive.
        wanted: Says of a directory whether it holds the data set.
        what: What it must hold, for the message.

    Returns:
        Where it is; the top of the source, if it is nowhere.

    Raises:
        RouteError: There are several, or as for `find_places`.
    """
    found = find_places(source, wanted)
    if len(found) > 1:
        raise RouteError(f"{readable(found[0])} and {readable(found[1])} both hold {what}; give one of them")
    return found[0] if found else TreePath(FolderTree(source) if source.is_dir() else ArchiveTree(source))


def _trees(source: Path, apart: bool) -> Iterator[FileTree]:
    if not source.is_dir():
        if not is_archive_name(source.name):
            problem = "is neither a directory nor a tar or zip archive" if source.exists() else "does not exist"
            raise RouteError(f"{readable(source)} {problem}; give the data set's directory, or its archive")
        yield ArchiveTree(source)
        return
    yield FolderTree(source)
    mounts = []
    for name in archives_in(source):
        above, last = posixpath.split(name)
        mounts.append((posixpath.join(above, archive_label(last)) if apart else above, source / name))
    if mounts:
        yield ArchiveTree(source, mounts)
