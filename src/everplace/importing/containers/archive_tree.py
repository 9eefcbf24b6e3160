"""Files inside archives, by name, as if the archives were unpacked."""

from __future__ import annotations

import errno
import io
import os
import posixpath
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import IO

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS
from everplace.importing.containers.archives import archive_label, is_archive_name, read_members, scan_members
from everplace.importing.containers.file_trees import Children, FileTree, FolderTree, files_below, is_image_name
from everplace.importing.foreign_route import Content, Encoded
from everplace.route.natural_order import natural_sorted

__all__ = ["ArchiveTree", "archives_in", "is_archive", "open_trees", "unread_note"]

# Lists and tables of an archive are met while it is listed: up to here they are kept, so that a compressed one need
# not be read once more for each.
_SMALL = 2**22
_MOST_KEPT = 2**26
_LARGEST_IN_MEMORY = 2**28
_LONGEST_CHAIN = 8
# What macOS adds to a zip.
_LEFTOVERS = "__MACOSX/"


class ArchiveTree:
    """What lies in a tar or zip (see `archives`), or in several together; images come in the order of the archive.

    A compressed tar is read to its end to list it, and once more each time that files of it are read.
    """

    def __init__(self, path: Path, mounts: Sequence[tuple[str, Path]] | None = None) -> None:
        """Lists the archives.

        Args:
            path: The archive, or the directory of several.
            mounts: Several archives, and the directory of the tree in which the names of each begin; None: `path`.

        Raises:
            RouteError: An archive is damaged, dangerous, holds a name twice, or a link to what it does not hold.
        """
        self.path = path
        self.label = path.absolute().name if mounts else archive_label(path.absolute().name)
        self._mounts = tuple(mounts or [("", path)])
        # Which archive holds a name; a name that several hold is refused when it is asked for.
        self._holder: dict[str, int] = {}
        self._others: dict[str, list[int]] = {}
        self._linked: dict[tuple[int, str], str] = {}
        self._kept: dict[tuple[int, str], bytes] = {}
        self._room = _MOST_KEPT
        for index in range(len(self._mounts)):
            self._list(index)

    @cached_property
    def images(self) -> tuple[str, ...]:
        """The names of all images."""
        return tuple(name for name in self._holder if is_image_name(name) and _is_visible(name))

    def locate(self, name: str) -> Path:
        """Returns where a file or directory is, for messages: its name in its archive, below the archive's path."""
        key = _key(name)
        index = self._holder.get(key, None if len(self._mounts) > 1 else 0)
        if index is None:
            below = (index for held, index in self._holder.items() if key and held.startswith(f"{key}/"))
            index = next(below, None)
        if index is None:
            return self.path / key
        prefix, archive = self._mounts[index]
        return archive / posixpath.relpath(key or ".", prefix or ".") if _lies_in(key, prefix) else self.path / key

    def is_dir(self, name: str) -> bool:
        """Says whether there is a directory of this name."""
        return _key(name) in self._directories

    def is_file(self, name: str) -> bool:
        """Says whether there is a file of this name."""
        return _key(name) in self._holder

    def children(self, name: str) -> Children:
        """Lists a directory."""
        directories, files = self._directories.get(_key(name), ({}, []))
        return Children(natural_sorted(filter(_is_visible, directories)), natural_sorted(filter(_is_visible, files)))

    def files(self, name: str) -> Iterator[str]:
        """Yields the files below a directory, in the order of the archive."""
        start = f"{_key(name)}/" if _key(name) else ""
        names = (name[len(start) :] for name in self._holder if name.startswith(start))
        return filter(_is_visible, names)

    def open(self, name: str) -> IO[bytes]:
        """Gives a file's content from memory."""
        key = _key(name)
        if key not in self._holder:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(self.locate(key)))
        first, *others = [self._content(index, key) for index in (self._holder[key], *self._others.get(key, ()))]
        if any(other != first for other in others):
            raise self._ambiguous(key)
        return io.BytesIO(first)

    def read(self, names: Iterable[str]) -> Iterator[tuple[str, Content]]:
        """Yields the files' contents, in the order of the archives, in one pass over each."""
        wanted: dict[int, dict[str, list[str]]] = {}
        for name in names:
            key = _key(name)
            if key not in self._holder:
                raise RouteError(f"{readable(self.locate(key))} does not exist; complete the archive")
            if key in self._others:
                raise self._ambiguous(key)
            index = self._holder[key]
            member = self._member(index, key)
            if (index, member) in self._kept:
                yield name, Encoded(self._kept[index, member], _ending(name))
            else:
                wanted.setdefault(index, {}).setdefault(member, []).append(name)
        for index, members in wanted.items():
            for member, data in read_members(self._mounts[index][1], members):
                for name in members[member]:
                    yield name, Encoded(data, _ending(name))

    @cached_property
    def _directories(self) -> dict[str, tuple[dict[str, None], list[str]]]:
        """Names of directories and files by the name of the directory they lie in."""
        found: dict[str, tuple[dict[str, None], list[str]]] = {"": ({}, [])}
        placed: set[str] = set()
        for name in self._holder:
            above, _, last = name.rpartition("/")
            found.setdefault(above, ({}, []))[1].append(last)
            # Those that are known have been put into what they lie in: a deep tree costs no more than a flat one.
            while above and above not in placed:
                placed.add(above)
                parent, _, part = above.rpartition("/")
                found.setdefault(parent, ({}, []))[0][part] = None
                above = parent
        return found

    def _list(self, index: int) -> None:
        """Lists an archive, and keeps its small files that are no images."""
        prefix, archive = self._mounts[index]
        names: dict[str, None] = {}
        links: dict[str, str] = {}
        twice: set[str] = set()
        member = None
        for member, content in scan_members(archive, lambda member: self._is_worth_keeping(member.name, member.size)):
            name = member.name
            if name.startswith(_LEFTOVERS):
                continue
            if name in names or name in links:
                if _is_visible(name):
                    raise RouteError(f"{readable(archive)} holds {name!a} twice; pack it again")
                twice.add(name)
            elif member.target:
                links[name] = member.target
            else:
                names[name] = None
                if content is not None:
                    self._kept[index, name] = content
                    self._room -= len(content)
        if member is None:
            raise RouteError(f"{readable(archive)} holds no file; get it again")
        # Nobody asks for the hidden files that tools leave behind, so those that come twice or lead nowhere do no harm.
        held = [name for name in names if name not in twice]
        for name, target in links.items():
            final = target
            for _ in range(_LONGEST_CHAIN):
                final = links.get(final, final)
            if final in names and final not in twice:
                self._linked[index, name] = final
                held.append(name)
            elif _is_visible(name):
                raise RouteError(
                    f"{readable(archive)} holds the link {name!a} to {target!a}, which is no file in it; pack it again "
                    "with the files that links lead to (tar --dereference)"
                )
        for name in held:
            self._hold(index, posixpath.join(prefix, name))

    def _hold(self, index: int, name: str) -> None:
        if self._holder.setdefault(name, index) != index:
            self._others.setdefault(name, []).append(index)

    def _is_worth_keeping(self, name: str, size: int) -> bool:
        return size <= min(_SMALL, self._room) and _is_visible(name) and not is_image_name(name)

    def _member(self, index: int, name: str) -> str:
        """Returns what an archive calls a file of the tree."""
        prefix = self._mounts[index][0]
        member = name[len(prefix) + 1 :] if prefix else name
        return self._linked.get((index, member), member)

    def _content(self, index: int, name: str) -> bytes:
        member, archive = self._member(index, name), self._mounts[index][1]
        if (index, member) not in self._kept:
            return _find_content(archive, member)
        return self._kept[index, member]

    def _ambiguous(self, name: str) -> RouteError:
        holders = [self._holder[name], *self._others[name]]
        first, second = (readable(self._mounts[index][1]) for index in holders[:2])
        member = self._member(holders[0], name)
        return RouteError(f"{first} and {second} both hold {member!a}; keep one of them, or unpack the right one")


def is_archive(path: os.PathLike[str]) -> bool:
    """Says whether something in a directory, or in an archive, is called like an archive and may be a file."""
    name = os.fspath(path)
    # A link to nothing is one: it is missed when it is opened.
    return is_archive_name(name) and (os.path.isfile(name) or not os.path.exists(name))  # noqa: PTH110, PTH113


def archives_in(directory: Path) -> list[str]:
    """Returns the names of the archives in a directory and in those in it, but not deeper, in natural order.

    Raises:
        RouteError: A directory cannot be listed.
    """
    return [name for name in files_below(directory, is_archive_name, 1) if is_archive(directory / name)]


def open_trees(source: Path, *, archives: bool = True) -> list[FileTree]:
    """Opens what holds a source's images: an archive, or a directory of images, of archives, or of both.

    Each archive (see `archives_in`) is a tree of its own.

    Args:
        source: The directory or archive.
        archives: Whether to open archives; otherwise a directory without images gives no tree, and an archive none.

    Raises:
        RouteError: It is none of these, or holds no image.
    """
    trees: list[FileTree] = []
    if source.is_dir():
        trees = [FolderTree(source)]
        if archives:
            trees += [ArchiveTree(source / name) for name in archives_in(source)]
    elif not is_archive_name(source.name):
        raise RouteError(
            f"{readable(source)} is neither a directory nor a tar or zip archive; give the directory that holds it"
        )
    elif archives:
        trees = [ArchiveTree(source)]
    trees = [tree for tree in trees if tree.images]
    if archives and not trees:
        raise RouteError(
            f"{readable(source)} holds no image (a file that ends in {', '.join(sorted(IMAGE_ENDINGS))}); check "
            "the path"
        )
    return trees


def unread_note(archives: Iterable[os.PathLike[str]]) -> list[str]:
    """Returns a sentence that names archives which were not read; none where there are none."""
    names = ", ".join(map(readable, archives))
    return [f"Not read, because what they lie beside or in was taken: {names}."] if names else []


def _find_content(archive: Path, member: str) -> bytes:
    found = scan_members(archive, lambda other: other.name == member and other.size <= _LARGEST_IN_MEMORY)
    for other, content in found:
        if content is not None:
            return content
        if other.name == member:
            raise RouteError(
                f"{readable(archive / member)} has {other.size} bytes, more than the {_LARGEST_IN_MEMORY} that are "
                "read from inside an archive; unpack it"
            )
    raise RouteError(f"{readable(archive)} no longer holds {readable(member)}; get it again")


def _ending(name: str) -> str:
    return os.path.splitext(name)[1]  # noqa: PTH122 - a path object for each frame takes long


def _is_visible(name: str) -> bool:
    return not name.startswith((".", _LEFTOVERS)) and "/." not in name


def _lies_in(name: str, directory: str) -> bool:
    return not directory or name == directory or name.startswith(f"{directory}/")


def _key(name: str) -> str:
    """Returns a name as an archive's tree knows it."""
    key = posixpath.normpath(name)
    return "" if key == "." else key
