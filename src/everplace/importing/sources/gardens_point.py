"""Gardens Point Walking: a walk over a campus, by day on both sides of the path and by night on the right.

The data set is Glover, "Day and Night, Left and Right", 2014, doi:10.5281/zenodo.4590133. Its copies hold
`day_left`, `day_right` and `night_right` with one image a place (`Image000.jpg`), but differ in capitals, in
what stands between the words, and in the images' names, whose number is what counts.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_directories
from everplace.importing.containers.file_trees import TreePath, read_frames
from everplace.importing.foreign_route import ForeignRoute, ForeignTraverse, SourceOptions
from everplace.route.natural_order import natural_sorted

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "Gardens Point Walking: day_left, day_right and night_right with one numbered image a place"

_TRAVERSES = ("day_left", "day_right", "night_right")
_NUMBER = re.compile(r"[^0-9]*([0-9]{1,9})[^0-9]*")


class Options(SourceOptions):
    """Options of the kind."""

    tolerance: Annotated[int, Field(ge=0)] = 3
    """Frames by which a match may be off. Neighbouring frames overlap, so 0 would be unfair."""
    condition: Literal["name", "light"] = "name"
    """What a traverse's condition is: its name, or light (day, day, night)."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a copy of the data set, or a directory above one, unpacked or as an archive.

    The stem of a frame is the number in its file's name, with three digits or more. What is unpacked counts before an
    archive beside it.

    Raises:
        RouteError: None of the three directories is there, one is there twice, a file's name holds no number or two, or
            an archive is damaged.
    """
    places, unread = find_directories(source, lambda place: bool(_traverse(place.name)) and bool(place.images))
    if not places:
        raise RouteError(
            f"{readable(source)} holds none of {', '.join(_TRAVERSES)}; give the directory or archive that does"
        )
    found: dict[str, TreePath] = {}
    for place in places:
        traverse = _traverse(place.name)
        if found.setdefault(traverse, place) is not place:
            raise RouteError(f"{readable(found[traverse])} and {readable(place)} are both {traverse}; give one copy")
    absent = [name for name in _TRAVERSES if name not in found]
    listed = {name: _by_number(found[name]) for name in _TRAVERSES if name in found}
    shared = set.intersection(*(set(frames) for frames in listed.values()))
    notes = ["Licence unknown: no licence came with the data set, so take it for research use only.", *unread]
    if absent:
        notes.append(f"The copy has no {' and no '.join(absent)}.")
    alone = {name: len(frames) - len(shared) for name, frames in listed.items() if len(frames) > len(shared)}
    if alone:
        counts = ", ".join(f"{count} of {name}" for name, count in alone.items())
        notes.append(f"Frames that not every traverse has: {counts}.")
    return ForeignRoute(
        traverses=(
            ForeignTraverse(
                name,
                read_frames(found[name], frames),
                condition=name.partition("_")[0] if options.condition == "light" else "",
                count=len(frames),
            )
            for name, frames in listed.items()
        ),
        tolerance=options.tolerance,
        notes=tuple(notes),
        truth_from="the data set's frame numbers, which are in step over the walks",
    )


def _traverse(directory: str) -> str:
    """Returns the traverse that a directory is called like, or nothing."""
    plain = re.sub(r"[\s._-]+", "", directory).lower()
    return next((traverse for traverse in _TRAVERSES if plain == traverse.replace("_", "")), "")


def _by_number(place: TreePath) -> dict[str, str]:
    """Returns the names of images by their stems, in order."""
    found: dict[str, str] = {}
    for name in place.images:
        match = _NUMBER.fullmatch(name.rpartition(".")[0])
        if match is None:
            raise RouteError(
                f"the name of {readable(place / name)} does not hold one number, so its place is unknown; rename it or "
                "move it away"
            )
        stem = f"{int(match[1]):03d}"
        if stem in found:
            raise RouteError(
                f"{readable(place)} holds {readable(found[stem])} and {readable(name)}, both of place {stem}; keep one "
                "of them"
            )
        found[stem] = name
    return {stem: found[stem] for stem in natural_sorted(found)}
