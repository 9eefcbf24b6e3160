"""What archives hold, by name: files, directories, and the content of small lists and tables."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import is_image_name
from everplace.importing.containers.archives import Member, read_members, scan_members

__all__ = ["ArchiveListing", "Mount", "is_visible"]

# Lists and tables of an archive are met while it is listed: up to here they are kept, so that a compressed one need
# not be read once more for each.
_MOST_KEPT = 2**26
_LONGEST_CHAIN = 8
# What macOS adds to a zip.
_LEFTOVERS = "__MACOSX/"


class Mount(NamedTuple):
    """An archive, and the directory of the tree in which the names in it begin."""

    directory: str
    archive: Path


class _Held(NamedTuple):
    """Where the content of a file is."""

    mount: Mount
    member: str


class ArchiveListing:
    """What archives hold.

    Attributes:
        held: Where each file is, by name; a name that several archives hold is refused when it is asked for.
        kept: The content of small files that are no images.
    """

    def __init__(self, mounts: Sequence[Mount]) -> None:
        """Lists archives.

        Raises:
            RouteError: One is damaged, dangerous, holds a name twice, or a link to what it does not hold.
        """
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

    def _list(self, mount: Mount) -> Iterator[tuple[str, str]]:
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
                if is_visible(name):
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
            elif name in links and is_visible(name):
                raise RouteError(
                    f"{readable(mount.archive)} holds the link {name!a} to {links[name]!a}, which is no file in it; "
                    "pack it again with the files that links lead to (tar --dereference)"
                )

    def _is_worth_keeping(self, member: Member) -> bool:
        return member.size <= self._room and is_visible(member.name) and not is_image_name(member.name)


def is_visible(name: str) -> bool:
    """Says whether a file or directory is none that tools hide or leave behind."""
    return not name.startswith((".", _LEFTOVERS)) and "/." not in name
