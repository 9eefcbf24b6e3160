"""Gardens Point Walking: a walk over a campus, by day on both sides of the path and by night on the right.

The data set is Glover, "Day and Night, Left and Right", 2014, doi:10.5281/zenodo.4590133. Its copies hold
`day_left`, `day_right` and `night_right` with one image a place (`Image000.jpg`), but differ in capitals, in
what stands between the words, and in the images' names, whose number is what counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from everplace.data.image_tree import image_names
from everplace.data.sources.protocol import ForeignFrame, ForeignRoute, ForeignTraverse, SourceOptions
from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "Gardens Point Walking: day_left, day_right and night_right with one numbered image a place"

_TRAVERSES = ("day_left", "day_right", "night_right")
_NUMBER = re.compile(r"[^0-9]*([0-9]{1,9})[^0-9]*")


class Options(SourceOptions):
    """Options of the kind.

    Attributes:
        tolerance: Frames by which a match may be off. Neighbouring frames overlap, so 0 would be unfair.
        condition: What a traverse's condition is: its name, or light (day, day, night).
    """

    tolerance: Annotated[int, Field(ge=0)] = 3
    condition: Literal["name", "light"] = "name"


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a copy of the data set, or a directory above one.

    The stem of a frame is the number in its file's name, with three digits or more.

    Raises:
        RouteError: None of the three directories is there, one is there twice, or a file's name holds no number
            or two.
    """
    found = _find(source)
    absent = [name for name in _TRAVERSES if name not in found]
    listed = {name: _by_number(directory) for name, directory in found.items()}
    shared = set.intersection(*(set(frames) for frames in listed.values()))
    notes = ["Licence unknown: no licence came with the data set, so take it for research use only."]
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
                _frames(found[name], frames),
                condition=name.partition("_")[0] if options.condition == "light" else "",
                count=len(frames),
            )
            for name, frames in listed.items()
        ),
        tolerance=options.tolerance,
        notes=tuple(notes),
    )


def _find(source: Path) -> dict[str, Path]:
    """Returns the directories by the traverses' names; looks in the source and one level below."""
    if not source.is_dir():
        problem = "is not a directory" if source.exists() else "does not exist"
        raise RouteError(f"{readable(source)} {problem}; give the directory that holds day_left")
    below = sorted(path for path in source.iterdir() if path.is_dir() and not path.name.startswith("."))
    deeper = sorted(path for parent in below for path in parent.iterdir() if path.is_dir())
    found: dict[str, Path] = {}
    for directory in [*below, *deeper]:
        name = re.sub(r"[\s._-]+", "", directory.name).lower()
        for traverse in _TRAVERSES:
            if name == traverse.replace("_", ""):
                if traverse in found:
                    raise RouteError(
                        f"{readable(found[traverse])} and {readable(directory)} are both {traverse}; give one copy"
                    )
                found[traverse] = directory
    if not found:
        raise RouteError(f"{readable(source)} holds none of {', '.join(_TRAVERSES)}; give the directory that does")
    return {name: found[name] for name in _TRAVERSES if name in found}


def _by_number(directory: Path) -> dict[str, str]:
    found: dict[str, str] = {}
    for name in image_names(directory):
        match = _NUMBER.fullmatch(name.rpartition(".")[0])
        if match is None:
            raise RouteError(
                f"the name of {readable(directory / name)} does not hold one number, so its place is unknown; "
                "rename it or move it away"
            )
        stem = f"{int(match[1]):03d}"
        if stem in found:
            raise RouteError(
                f"{readable(directory)} holds {found[stem]} and {name}, both of place {stem}; keep one of them"
            )
        found[stem] = name
    return found


def _frames(directory: Path, names: dict[str, str]) -> Iterator[ForeignFrame]:
    for stem, name in names.items():
        yield ForeignFrame(stem, directory / name)
