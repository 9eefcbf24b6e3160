"""Finding data sets in what the user gave: a directory or an archive, however deep they lie there."""

from __future__ import annotations

import contextlib
import posixpath
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.archive_tree import ArchivePath, archives_in, is_archive, unread_note
from everplace.importing.containers.archives import is_archive_name
from everplace.importing.containers.file_trees import TreePath

__all__ = ["FoundDirectories", "find_data_set", "find_directories"]

# A data set may lie in a directory of the archive, and that in another; KITTI's sequences lie two levels below.
_DEEPEST = 4


class FoundDirectories(NamedTuple):
    """What was found in a source.

    Attributes:
        found: The directories, those nearest to the top first, each level in natural order.
        notes: Sentences that say what lies in the source and was not read.
    """

    found: list[TreePath]
    notes: list[str]


class _Search(NamedTuple):
    """What one tree holds: the wanted places, the archives outside them by name, and why one was not searched."""

    found: list[TreePath]
    archives: dict[str, TreePath]
    closed: list[RouteError]


def find_directories(source: Path, wanted: Callable[[TreePath], bool], *, apart: bool = False) -> FoundDirectories:
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
        found, nested, _ = _search(ArchivePath(source), wanted)
        return FoundDirectories(found, unread_note(nested.values()) if found else [])
    found, archives, closed = _search(TreePath(source), wanted)
    notes = []
    unread = [archive for place in found for archive in _archives_below(place, closed)]
    if apart:
        for archive in archives.values():
            inside, nested, _ = _search(ArchivePath(Path(archive)), wanted)
            if not inside:
                notes.append(f"{readable(archive)} holds no sequence.")
            found += inside
            unread += nested.values()
    elif archives and not found:
        mounts = [(posixpath.dirname(name), Path(archive)) for name, archive in archives.items()]
        found, nested, _ = _search(ArchivePath(source, mounts), wanted)
        unread += nested.values()
    else:
        unread += archives.values()
    if closed and not found:
        raise closed[0]
    notes += [f"A directory was not searched: {error}." for error in closed]
    return FoundDirectories(found, unread_note(unread) + notes)


def find_data_set(
    source: Path, wanted: Callable[[TreePath], bool], what: str, *, preferred: str = ""
) -> tuple[TreePath, list[str]]:
    """Finds the one data set in what the user gave; see `find_directories`.

    Args:
        source: A directory or an archive.
        wanted: Says of a directory whether it holds the data set.
        what: What it must hold, for the message.
        preferred: The name of the directory that counts where there are several.

    Returns:
        Where it is, or the top of the source if it is nowhere; and sentences that say what was not read.

    Raises:
        RouteError: There are several, or as for `find_directories`.
    """
    places = find_directories(source, wanted)
    found = [place for place in places.found if place.name == preferred] or places.found
    if len(found) > 1:
        remedy = "give one of them" if found[0].is_on_disk else "unpack the archive and give one of them"
        raise RouteError(f"{readable(found[0])} and {readable(found[1])} both hold {what}; {remedy}")
    if found:
        return found[0], places.notes
    return (TreePath if source.is_dir() else ArchivePath)(source), []


def _archives_below(place: TreePath, closed: list[RouteError]) -> list[TreePath]:
    """Returns the archives in a directory; if that fails, adds to `closed` why."""
    try:
        return [place / name for name in archives_in(Path(place))]
    except RouteError as error:
        closed.append(error)
        return []


def _search(top: TreePath, wanted: Callable[[TreePath], bool]) -> _Search:
    result = _Search([], {}, [])
    entered: set[tuple[int, int]] = set()
    level = {"": top}
    for _ in range(_DEEPEST + 1):
        below: dict[str, TreePath] = {}
        for inside, place in level.items():
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
                if not inside:
                    raise
                result.closed.append(error)
                continue
            for name in filter(is_archive_name, files):
                if not place.is_on_disk or is_archive(Path(place / name)):
                    result.archives[posixpath.join(inside, name)] = place / name
            below |= {posixpath.join(inside, name): place / name for name in directories}
        # A directory counts before a link to it.
        level = dict(sorted(below.items(), key=lambda item: item[1].is_on_disk and Path(item[1]).is_symlink()))
    return result
