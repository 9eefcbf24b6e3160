"""Files inside archives, by name, as if the archives were unpacked."""

from __future__ import annotations

import errno
import io
import os
import posixpath
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import IO, NamedTuple

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS, is_image_name
from everplace.images.frame_names import unread_pictures
from everplace.importing.containers.archives import (
    Member,
    archive_label,
    is_archive_name,
    read_members,
    scan_members,
)
from everplace.importing.containers.file_trees import Children, TreePath, files_below
from everplace.importing.foreign_route import Content, Encoded
from everplace.route.natural_order import natural_sorted

__all__ = ["ArchivePath", "archives_in", "is_archive", "open_trees", "unread_note"]

# Lists and tables of an archive are met while it is listed: up to here they are kept, so that a compressed one need
# not be read once more for each.
_MOST_KEPT = 2**26
_LONGEST_CHAIN = 8
# What macOS adds to a zip.
_LEFTOVERS = "__MACOSX/"


class _Mount(NamedTuple):
    """An archive, and the directory of the tree in which the names in it begin."""

    directory: str
    archive: Path


class _Held(NamedTuple):
    """Where the content of a file is."""

    mount: _Mount
    member: str


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
        self._listing = _Listing([_Mount(*mount) for mount in mounts or [("", path)]])

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
        return Children(natural_sorted(filter(_is_visible, directories)), natural_sorted(filter(_is_visible, files)))

    def files(self) -> Iterator[str]:
        """Yields the files below it, in the order of the archive."""
        start = f"{self._inside}/" if self._inside else ""
        names = (name[len(start) :] for name in self._listing.held if name.startswith(start))
        return filter(_is_visible, names)

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


class _Listing:
    """What archives hold.

    Attributes:
        held: Where each file is, by name; a name that several archives hold is refused when it is asked for.
        kept: The content of small files that are no images.
    """

    def __init__(self, mounts: Sequence[_Mount]) -> None:
        self.held: dict[str, list[_Held]] = {}
        self.kept: dict[_Held, bytes] = {}
        self._mounts = mounts
        self._room = _MOST_KEPT
        for mount in mounts:
            for name, member in self._list(mount):
                self.held.setdefault(posixpath.join(mount.directory, name), []).append(_Held(mount, member))

    @cached_property
    def directories(self) -> dict[str, tuple[list[str], list[str]]]:
        """The names of the directories and of the files in each directory."""
        found: dict[str, tuple[list[str], list[str]]] = {"": ([], [])}

        def directory(name: str) -> tuple[list[str], list[str]]:
            # One that is known lies in its own already: a deep tree costs no more than a flat one.
            if name not in found:
                above, _, last = name.rpartition("/")
                directory(above)[0].append(last)
                found[name] = ([], [])
            return found[name]

        for name in self.held:
            above, _, last = name.rpartition("/")
            directory(above)[1].append(last)
        return found

    def locate(self, name: str) -> Path | None:
        """Returns where a file or directory is, for messages: what its archive calls it, below the archive's path."""
        holding = (held for file, held in self.held.items() if name and file.startswith(f"{name}/"))
        held = self.held.get(name) or next(holding, None)
        mount = held[0].mount if held else self._mounts[0]
        if not (held or len(self._mounts) == 1) or not f"{name}/".startswith(posixpath.join(mount.directory, "")):
            return None
        return mount.archive / posixpath.relpath(name or ".", mount.directory or ".")

    def content(self, held: _Held) -> bytes:
        """Reads a file into memory."""
        if held in self.kept:
            return self.kept[held]
        return next(read_members(held.mount.archive, [held.member]))[1]

    def ambiguous(self, name: str) -> RouteError:
        """Returns an error that names two archives which hold a file."""
        first, second = (readable(held.mount.archive) for held in self.held[name][:2])
        return RouteError(
            f"{first} and {second} both hold {self.held[name][0].member!a}; keep one of them, or unpack the right one"
        )

    def _list(self, mount: _Mount) -> Iterator[tuple[str, str]]:
        """Yields each file's name, and the member that holds its content; small ones that are no images are kept."""
        files: dict[str, None] = {}
        links: dict[str, str] = {}
        twice: set[str] = set()
        member = None
        for member, content in scan_members(mount.archive, self._is_worth_keeping, bombs="skip"):
            name = member.name
            if name.startswith(_LEFTOVERS):
                continue
            if name in files or name in links:
                if _is_visible(name):
                    raise RouteError(f"{readable(mount.archive)} holds {name!a} twice; pack it again")
                twice.add(name)
            elif member.target:
                links[name] = member.target
            else:
                files[name] = None
                if content is not None:
                    self.kept[_Held(mount, name)] = content
                    self._room -= len(content)
        if member is None:
            raise RouteError(f"{readable(mount.archive)} holds no file; get it again")
        # Nobody asks for the hidden files that tools leave behind, so those that come twice or lead nowhere do no harm.
        for name in (*files, *links):
            final = name
            for _ in range(_LONGEST_CHAIN):
                final = links.get(final, final)
            if final in files and twice.isdisjoint((name, final)):
                yield name, final
            elif name in links and _is_visible(name):
                raise RouteError(
                    f"{readable(mount.archive)} holds the link {name!a} to {links[name]!a}, which is no file in it; "
                    "pack it again with the files that links lead to (tar --dereference)"
                )

    def _is_worth_keeping(self, member: Member) -> bool:
        return member.size <= self._room and _is_visible(member.name) and not is_image_name(member.name)


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


def _is_visible(name: str) -> bool:
    return not name.startswith((".", _LEFTOVERS)) and "/." not in name
