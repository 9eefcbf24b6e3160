"""A route as a directory with one sub-directory of images for each traverse."""

from __future__ import annotations

import os
from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path

from everplace.data.images import IMAGE_ENDINGS
from everplace.data.natural_order import natural_sorted
from everplace.data.poses import read_poses
from everplace.data.route_toml import ROUTE_TOML, RouteToml, TraverseToml
from everplace.data.traverse import Traverse
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["POSES_CSV", "read_traverses"]

POSES_CSV = "poses.csv"
"""The poses of a traverse are found under this name in its directory, unless route.toml names another file."""


def read_traverses(root: Path, settings: RouteToml) -> tuple[Traverse, ...]:
    """Lists a route's directory; no image is opened.

    Hidden files and directories are left out, and so are files without an image's ending. A directory without images
    is an error, unless route.toml ignores it or finds poses in it.

    Args:
        root: The route's directory.
        settings: What its route.toml says.

    Returns:
        The traverses in natural order of their names.

    Raises:
        RouteError: `root` is missing or not a route, a traverse is empty, holds a stem twice or a name that is not
            UTF-8, or its poses are wrong.
    """
    names = [
        name
        for name in _sub_directories(root)
        if name not in settings.ignore and not _only_holds_poses(root, name, settings)
    ]
    unknown = natural_sorted(set(settings.traverses) - set(names))
    if unknown:
        raise RouteError(
            f"{readable(root / ROUTE_TOML)} speaks of the traverse {unknown[0]!r}, but there is no such directory; "
            f"there are: {', '.join(names) or 'none'}"
        )
    if not names:
        raise _no_traverses(root)
    return tuple(_read_traverse(root, name, settings.traverses.get(name, TraverseToml())) for name in names)


def _sub_directories(root: Path) -> list[str]:
    """Returns the names of the directories in a route that are not hidden, in natural order."""
    if not root.exists():
        raise RouteError(
            f"the route {readable(root)} does not exist; give the directory that holds the traverses"
        )
    if not root.is_dir():
        raise RouteError(
            f"the route {readable(root)} is not a directory; give the directory that holds the traverses"
        )
    names, _ = _list(root)
    for name in names:
        _refuse_foreign_bytes(root, name)
    return natural_sorted(names)


def _only_holds_poses(root: Path, name: str, settings: RouteToml) -> bool:
    """Says whether a directory is where route.toml finds poses, and has no images of its own."""
    holds_poses = any(
        traverse.poses is not None and (root / traverse.poses).parent == root / name
        for traverse in settings.traverses.values()
    )
    return holds_poses and name not in settings.traverses and not _has_images(root / name)


def _no_traverses(root: Path) -> RouteError:
    """Tells a single traverse from a directory with nothing in it."""
    if _has_images(root):
        return RouteError(
            f"{readable(root)} holds images itself, so it is a single traverse and not a route; give the directory "
            f"above it ({readable(root.absolute().parent)}) or move the images into a sub-directory"
        )
    return RouteError(
        f"the route {readable(root)} holds no traverse; make one sub-directory of images for each traverse"
    )


def _read_traverse(root: Path, name: str, settings: TraverseToml) -> Traverse:
    """Lists one traverse and reads its poses."""
    directory = root / name
    endings = _frames(directory, settings.pattern)
    if not endings:
        wanted = (
            f"matches {settings.pattern!r}"
            if settings.pattern
            else f"ends in {', '.join(sorted(IMAGE_ENDINGS))}"
        )
        raise RouteError(
            f"the traverse {readable(directory)} is empty: no file in it {wanted}; add its images, remove the "
            f"directory, or name it under `ignore` in {ROUTE_TOML}"
        )
    stems = tuple(natural_sorted(endings))
    poses_file = directory / POSES_CSV if settings.poses is None else root / settings.poses
    has_poses = settings.poses is not None or poses_file.is_file()
    return Traverse(
        name=name,
        condition=settings.condition or name,
        root=directory,
        stems=stems,
        endings=tuple(endings[stem] for stem in stems),
        poses=read_poses(poses_file, stems) if has_poses else None,
    )


def _frames(directory: Path, pattern: str | None) -> dict[str, str]:
    """Returns the file ending of each stem in a traverse's directory, in no order."""
    chosen: Callable[[str], bool] = (
        _has_image_ending if pattern is None else lambda name: fnmatchcase(name, pattern)
    )
    known: dict[str, str] = {}
    endings: dict[str, str] = {}
    _, files = _list(directory)
    for name in files:
        if not chosen(name):
            continue
        _refuse_foreign_bytes(directory, name)
        stem, ending = os.path.splitext(name)  # noqa: PTH122 - a Path for each of a million names takes seconds
        # One object for each ending, not one for each frame.
        ending = known.setdefault(ending, ending)
        if stem in endings:
            first, second = sorted((stem + endings[stem], name))
            raise RouteError(
                f"{readable(directory)} holds {first} and {second}, two frames of the same stem; keep one of them, or "
                f"give a `pattern` in {ROUTE_TOML}"
            )
        endings[stem] = ending
    return endings


def _has_images(directory: Path) -> bool:
    """Says whether any file in a directory has an image's ending."""
    return any(_has_image_ending(name) for name in _list(directory)[1])


def _has_image_ending(name: str) -> bool:
    """Says whether a file name ends as an image's does, in capitals or not."""
    return os.path.splitext(name)[1].lower() in IMAGE_ENDINGS  # noqa: PTH122


def _list(directory: Path) -> tuple[list[str], list[str]]:
    """Returns the names of sub-directories and of everything else, hidden ones left out, in no order.

    A link that leads nowhere counts as a file: it is a frame that cannot be decoded, and must not vanish in silence.
    """
    directories: list[str] = []
    files: list[str] = []
    try:
        with os.scandir(directory) as entries:
            for entry in entries:
                if not entry.name.startswith("."):
                    (directories if entry.is_dir() else files).append(entry.name)
    except OSError as error:
        raise RouteError(
            f"cannot list {readable(directory)}: {error.strerror or error}; check its permissions"
        ) from error
    return directories, files


def _refuse_foreign_bytes(directory: Path, name: str) -> None:
    """Raises `RouteError` for a name that is not UTF-8: no CSV, HDF5 or JSON file could carry it."""
    if name.isascii():
        return
    try:
        name.encode("utf-8")
    except UnicodeEncodeError as error:
        raise RouteError(f"the name of {readable(directory / name)} is not UTF-8; rename it") from error
