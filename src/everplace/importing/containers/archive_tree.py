"""Files inside archives, by name, as if the archives were unpacked."""

from __future__ import annotations

import errno
import io
import os
import posixpath
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.images.frame_names import unread_pictures
from everplace.importing.containers.archive_listing import ArchiveListing, Mount, is_visible
from everplace.importing.containers.archives import archive_label, is_archive_name, read_members
from everplace.importing.containers.file_trees import Children, TreePath, files_below
from everplace.importing.foreign_route import Content, Encoded
from everplace.route.natural_order import natural_sorted

__all__ = ["ArchivePath", "archives_in", "is_archive", "open_trees", "unread_note"]


class ArchivePath(TreePath):
    """A file or directory in a tar or zip (see `archives`), or in several together as if unpacked in one place.

    Files come in the order of the archive. A compressed tar is read to its end to list it, and once more each time that
    files of it are read.
    """

    is_on_disk = False

    def __init__(self, path: Path, mounts: Sequence[tuple[str, Path]] | None = None) -> None:
        """Lists the archives; this is their top.

        Args:
            path: The archive, or the directory of several.
            mounts: Several archives, and the directory of the tree in which the names of each begin; None: `path`.

        Raises:
            RouteError: An archive is damaged, dangerous, holds a name twice, or a link to what it does not hold.
        """
        name = path.absolute().name
        self.source = path
        self._top = name if mounts else archive_label(name)
        self._inside = ""
        self._listing = ArchiveListing([Mount(*mount) for mount in mounts or [("", path)]])

    def __fspath__(self) -> str:
        return str(self._listing.locate(self._inside) or self.source / self._inside)

    def __truediv__(self, name: str) -> TreePath:
        if Path(name).is_absolute():
            return TreePath(Path(name))
        below = object.__new__(ArchivePath)
        below.source, below._top, below._listing = self.source, self._top, self._listing
        inside = posixpath.normpath(posixpath.join(self._inside, name))
        below._inside = "" if inside == "." else inside
        return below

    @property
    def name(self) -> str:
        """The last part of the path."""
        return posixpath.basename(self._inside) or self._top

    @property
    def parent(self) -> TreePath:
        """What it lies in."""
        return self / ".." if self._inside else self

    def is_dir(self) -> bool:
        """Says whether it is a directory."""
        return self._inside in self._listing.directories

    def is_file(self) -> bool:
        """Says whether it is a file."""
        return self._inside in self._listing.held

    def children(self) -> Children:
        """Lists what lies in it."""
        directories, files = self._listing.directories.get(self._inside, ([], []))
        return Children(natural_sorted(filter(is_visible, directories)), natural_sorted(filter(is_visible, files)))

    def files(self) -> Iterator[str]:
        """Yields the files below it, in the order of the archive."""
        start = f"{self._inside}/" if self._inside else ""
        names = (name[len(start) :] for name in self._listing.held if name.startswith(start))
        return filter(is_visible, names)

    def open(self) -> IO[bytes]:
        """Gives the file's content from memory."""
        if not self.is_file():
            reason = os.strerror(errno.ENOENT)
            raise RouteError(f"cannot read {readable(self)}: {reason}; check that the data set is whole")
        first, *others = map(self._listing.content, self._listing.held[self._inside])
        if any(other != first for other in others):
            raise self._listing.ambiguous(self._inside)
        return io.BytesIO(first)

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Yields contents, in the order of the archives, in one pass over each."""
        wanted: dict[Path, dict[str, list[str]]] = {}
        for name in names:
            inside = posixpath.normpath(posixpath.join(self._inside, name))
            held = self._listing.held.get(inside, ())
            if not held:
                raise RouteError(f"{readable(self / name)} does not exist; complete the archive")
            if len(held) > 1:
                raise self._listing.ambiguous(inside)
            if held[0] in self._listing.kept:
                yield name, Encoded(self._listing.kept[held[0]], _ending(name))
            else:
                wanted.setdefault(held[0].mount.archive, {}).setdefault(held[0].member, []).append(name)
        for archive, members in wanted.items():
            for member, data in read_members(archive, members):
                for name in members[member]:
                    yield name, Encoded(data, _ending(name))


def is_archive(path: Path) -> bool:
    """Says whether something on the disk is called like an archive and may be a file."""
    # A link to nothing is one: it is missed when it is opened.
    return is_archive_name(path.name) and (path.is_file() or not path.exists())


def archives_in(directory: Path) -> list[str]:
    """Returns the names of the archives in a directory and in those in it, but not deeper, in natural order.

    Raises:
        RouteError: A directory cannot be listed.
    """
    return [name for name in files_below(directory, is_archive_name, 1) if is_archive(directory / name)]


def open_trees(source: Path, *, archives: bool = True) -> list[TreePath]:
    """Opens what holds a source's images: an archive, or a directory of images, of archives, or of both.

    Each archive (see `archives_in`) is a tree of its own.

    Args:
        source: The directory or archive.
        archives: Whether to open archives; otherwise a directory without images gives no tree, and an archive none.

    Raises:
        RouteError: It is none of these, or holds no image.
    """
    trees: list[TreePath] = []
    if source.is_dir():
        trees = [TreePath(source)]
        if archives:
            trees += [ArchivePath(source / name) for name in archives_in(source)]
    elif not is_archive_name(source.name):
        raise RouteError(
            f"{readable(source)} is neither a directory nor a tar or zip archive; give the directory that holds it"
        )
    elif archives:
        trees = [ArchivePath(source)]
    opened, trees = trees, [tree for tree in trees if tree.images]
    if archives and not trees:
        unread = unread_pictures(name for tree in opened for name in tree.files())
        raise RouteError(
            f"{readable(source)} holds no image (a file that ends in {', '.join(sorted(IMAGE_ENDINGS))}){unread}; "
            "check the path"
        )
    return trees


def unread_note(archives: Iterable[os.PathLike[str]]) -> list[str]:
    """Returns a sentence that names archives which were not read; none where there are none."""
    names = ", ".join(map(readable, archives))
    return [f"Not read, because what they lie beside or in was taken: {names}."] if names else []


def _ending(name: str) -> str:
    return os.path.splitext(name)[1]  # noqa: PTH122 - a path object for each frame takes long
