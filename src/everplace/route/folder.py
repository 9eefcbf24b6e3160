"""A route as a directory with one sub-directory of images for each traverse."""

from __future__ import annotations

import fnmatch
import os
from dataclasses import replace
from operator import methodcaller
from pathlib import Path

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS, is_image_name
from everplace.images.frame_names import choose_frames, unread_pictures
from everplace.route.csv_table import read_poses
from everplace.route.natural_order import natural_sorted
from everplace.route.route_toml import ROUTE_TOML, RouteToml, TraverseToml
from everplace.route.traverse import Traverse

__all__ = ["POSES_CSV", "TIMES_CSV", "list_directory", "open_traverse", "read_traverses"]

POSES_CSV = "poses.csv"
"""Where the poses of a traverse are, in its directory, unless route.toml names another file."""

TIMES_CSV = "times.csv"
"""When the frames of a traverse were taken, in its directory: columns stem, seconds."""

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))


def read_traverses(root: Path, settings: RouteToml) -> tuple[Traverse, ...]:
    """Lists a route's directory; no image is opened.

    Hidden files and directories are left out, and so are files without an image's ending; a warning counts the
    pictures and recordings among them. A directory without
    images is an error, unless route.toml ignores it or finds poses in it.

    Args:
        root: The route's directory.
        settings: What its route.toml says.

    Returns:
        The traverses in natural order of their names.

    Raises:
        RouteError: `root` is missing or not a route, a traverse is empty, holds a stem twice or a name that
            is not UTF-8, or its poses are wrong.
        MissingExtraError: A frame is HEIC or AVIF, and what reads that is not installed.
    """
    names = [
        name
        for name in _sub_directories(root)
        if name not in settings.ignore and not _only_holds_poses(root, name, settings)
    ]
    unknown = natural_sorted(set(settings.traverses) - set(names))
    if unknown:
        raise RouteError(
            f"{readable(root / ROUTE_TOML)} speaks of the traverse {unknown[0]!r}, but there is no such "
            f"directory; there are: {', '.join(map(readable, names)) or 'none'}"
        )
    if not names:
        raise _no_traverses(root)
    return tuple(_read_traverse(root, name, settings.traverses.get(name, TraverseToml())) for name in names)


def open_traverse(directory: Path) -> Traverse:
    """Lists one directory of images as a traverse without poses, with no route around it; no image is opened.

    Raises:
        RouteError: There is no such directory, it holds no image, or two files share a stem.
    """
    if not directory.is_dir():
        problem = "is not a directory" if directory.exists() else "does not exist"
        raise RouteError(f"{readable(directory)} {problem}; give a directory that holds images")
    whole = directory.absolute()
    inner, names = list_directory(whole)
    traverses = (
        [] if _images(names) else [name for name in natural_sorted(inner) if _images(list_directory(whole / name)[1])]
    )
    if traverses:
        raise RouteError(
            f"{readable(directory)} holds no images itself, but directories of images; give one of them, such as "
            f"{readable(directory / traverses[0])}"
        )
    return _list_traverse(whole.parent, whole.name, TraverseToml())


def _sub_directories(root: Path) -> list[str]:
    """Returns the names of the directories in a route that are not hidden, in natural order."""
    if not root.is_dir():
        problem = "is not a directory" if root.exists() else "does not exist"
        raise RouteError(f"the route {readable(root)} {problem}; give the directory that holds the traverses")
    names, _ = list_directory(root)
    _refuse_foreign_bytes(root, names)
    return natural_sorted(names)


def _only_holds_poses(root: Path, name: str, settings: RouteToml) -> bool:
    """Says whether a directory is where route.toml finds poses, and has no images of its own."""
    holds_poses = any(
        traverse.poses is not None and (root / traverse.poses).parent == root / name
        for traverse in settings.traverses.values()
    )
    return holds_poses and name not in settings.traverses and not _images(list_directory(root / name)[1])


def _no_traverses(root: Path) -> RouteError:
    """Tells a single traverse from a directory with nothing in it."""
    if _images(list_directory(root)[1]):
        return RouteError(
            f"{readable(root)} holds images itself, so it is a single traverse and not a route; give the "
            f"directory above it ({readable(root.absolute().parent)}) or move the images into a sub-directory"
        )
    return RouteError(
        f"the route {readable(root)} holds no traverse; make one sub-directory of images for each traverse"
    )


def _read_traverse(root: Path, name: str, settings: TraverseToml) -> Traverse:
    """Lists one traverse and reads its poses."""
    traverse = _list_traverse(root, name, settings)
    poses_file = traverse.root / POSES_CSV if settings.poses is None else root / settings.poses
    if settings.poses is None and not poses_file.is_file():
        return traverse
    return replace(traverse, poses=read_poses(poses_file, traverse.stems))


def _list_traverse(root: Path, name: str, settings: TraverseToml) -> Traverse:
    """Lists one traverse, without poses."""
    directory = root / name
    stems, endings = _frames(directory, settings.pattern)
    if not stems:
        unread = unread_pictures(list_directory(directory)[1])
        wanted = f"matches {settings.pattern!r}" if settings.pattern else f"ends in {', '.join(_ENDINGS)}"
        raise RouteError(
            f"the traverse {readable(directory)} is empty: no file in it {wanted}{unread}; add its images, "
            f"remove the directory, or name it under `ignore` in {ROUTE_TOML}"
        )
    return Traverse(name=name, condition=settings.condition or name, root=directory, stems=stems, endings=endings)


def _frames(directory: Path, pattern: str | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Returns the stems in a traverse's directory in natural order, and the file ending of each."""
    names = list_directory(directory)[1]
    names = choose_frames(directory, names, recordings=True) if pattern is None else fnmatch.filter(names, pattern)
    _refuse_foreign_bytes(directory, names)
    if ending := _common_ending(names):
        stems = natural_sorted([name[: -len(ending)] for name in names])
        return tuple(stems), (ending,) * len(stems)
    endings = _endings(directory, names)
    stems = natural_sorted(endings)
    return tuple(stems), tuple(endings[stem] for stem in stems)


def _common_ending(names: list[str]) -> str:
    """Returns the ending, dot included, that all names have; empty if there is none."""
    ending = "".join(names[0].rpartition(".")[1:]) if names and "." in names[0] else ""
    return ending if all(map(methodcaller("endswith", ending), names)) else ""


def _endings(directory: Path, names: list[str]) -> dict[str, str]:
    """Returns the file ending of each stem."""
    known: dict[str, str] = {}
    endings: dict[str, str] = {}
    for name in names:
        # Not os.path.splitext, which takes seconds for a million names. Hidden files, whose stem is empty,
        # are out.
        stem, dot, ending = name.rpartition(".")
        if not dot:
            stem, ending = name, ""
        if stem in endings:
            first, second = map(readable, sorted((stem + endings[stem], name)))
            raise RouteError(
                f"{readable(directory)} holds {first} and {second}, two frames of the same stem; keep one of "
                f"them, or give a `pattern` in {ROUTE_TOML}"
            )
        # One object for each ending, not one for each frame.
        endings[stem] = known.setdefault(ending, dot + ending)
    return endings


def _images(names: list[str]) -> list[str]:
    """Returns the names that end as an image's does, in capitals or not."""
    return list(filter(is_image_name, names))


def list_directory(directory: Path) -> tuple[list[str], list[str]]:
    """Returns the names of sub-directories and of everything else, hidden ones left out, in no order.

    A link that leads nowhere counts as a file: it is a frame that cannot be decoded, and must not vanish in
    silence.

    Raises:
        RouteError: The directory cannot be listed, or a link in it leads to itself.
    """
    directories: list[str] = []
    files: list[str] = []
    last = ""
    try:
        with os.scandir(directory) as entries:
            for entry in entries:
                if not entry.name.startswith("."):
                    last = entry.name
                    (directories if entry.is_dir() else files).append(last)
    except OSError as error:
        reason = error.strerror or error
        if (directory / last).is_symlink():
            raise RouteError(
                f"cannot follow the link {readable(directory / last)}: {reason}; remove it or mend it"
            ) from error
        raise RouteError(f"cannot list {readable(directory)}: {reason}; check the path and its permissions") from error
    return directories, files


def _refuse_foreign_bytes(directory: Path, names: list[str]) -> None:
    """Raises `RouteError` for a name that is not UTF-8: no CSV, HDF5 or JSON file could carry it."""
    try:
        "".join(names).encode("utf-8")
    except UnicodeEncodeError as error:
        foreign = min(name for name in names if any("\udc80" <= letter <= "\udcff" for letter in name))
        raise RouteError(f"the name of {readable(directory / foreign)} is not UTF-8; rename it") from error
