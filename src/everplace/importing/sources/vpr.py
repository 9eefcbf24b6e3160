"""The place-recognition convention in which a file's name says where the image was taken.

    SOURCE/images/{train,val,test}/{database,queries}/**/@EAST@NORTH@ZONE@BAND@LAT@LON@ID@TILE@HEADING@...@.jpg

It is that of Berton et al., "Deep Visual Geo-localization Benchmark", CVPR 2022: fields between `@`, most of
them may be empty; only the UTM coordinates must be there. Two images show the same place within 25 m.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_data_set
from everplace.importing.containers.file_trees import TreePath, by_stem, image_names, read_files
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse, ScaledOptions
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "Images of a database and of queries whose file names hold UTM coordinates: @east@north@...@.jpg"

_SPLITS = ("train", "val", "test")
_TRAVERSES = ("database", "queries")
# Positions between the `@` of a complete name, which has these many parts.
_EAST, _NORTH, _ZONE, _HEADING, _TIME, _COMPLETE = 1, 2, 3, 9, 13, 16
_ZONE_WIDTH = 1_000_000.0


class Options(ScaledOptions):
    """Options of the kind."""

    split: Literal["train", "val", "test"] = "test"
    """Which of train, val and test."""
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 25.0
    """Metres up to which two images show the same place."""


class _Place(NamedTuple):
    """What a file's name says."""

    zone: int | None
    east: float
    north: float
    heading: float
    seconds: float | None


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a data set, its `images` directory, or a directory that holds `database` and `queries`, or an archive.

    The pose is the UTM position; the heading is field 9 (degrees clockwise from north), or 0 where it is
    empty. The eastings of several UTM zones would overlap, so each zone lies 1,000 km east of the one before.
    Images in sub-directories get the sub-directory into their stem. Times are given where all names of a
    directory hold a whole one, YYYYMMDD_hhmmss.

    Raises:
        RouteError: There is no such split, it holds no image, a file's name holds no coordinates, or an archive is
            damaged.
    """
    split, notes = _find(source, options.split)
    directories = [split / name for name in _TRAVERSES]
    listed = {directory: by_stem(directory, image_names(directory)) for directory in directories}
    zones: set[int] = set()
    timed: dict[TreePath, bool] = {}
    for directory, names in listed.items():
        places = [_place(directory, name) for name in names.values()]
        zones.update(place.zone for place in places if place.zone is not None)
        timed[directory] = all(place.seconds is not None for place in places)
    known = sorted(zones)
    notes.append(
        f"Two images show the same place within {options.radius:g} m (the protocol's own radius is 25 m); headings are "
        "not compared."
    )
    if len(known) > 1:
        notes.append(
            f"The images lie in the UTM zones {', '.join(map(str, known))}; each zone was moved 1,000 km east of the "
            "one before, so images on the two sides of a border between zones never match."
        )
    shift = {zone: index * _ZONE_WIDTH for index, zone in enumerate(known)}
    return ForeignRoute(
        traverses=(
            ForeignTraverse(directory.name, _frames(directory, names, shift, timed[directory]), count=len(names))
            for directory, names in listed.items()
        ),
        radius=options.radius,
        notes=tuple(notes),
        truth_from="the positions (UTM) in the names of the data set's images",
    )


def _find(source: Path, split: str) -> tuple[TreePath, list[str]]:
    root, notes = find_data_set(
        source,
        lambda place: any(map(_is_split, (place, *(one for name in _SPLITS for one in _places(place, name))))),
        "images of a database and of queries",
    )
    for candidate in (*_places(root, split), root):
        if _is_split(candidate):
            return candidate, notes
    there = [name for name in _SPLITS if any(one.is_dir() for one in _places(root, name))]
    remedy = f"choose `split`= one of {', '.join(there)}" if there else "give the directory above images"
    raise RouteError(f"{readable(source)} holds no images/{split} with the directories database and queries; {remedy}")


def _places(root: TreePath, split: str) -> tuple[TreePath, ...]:
    """Returns where a split may lie."""
    return root / "images" / split, root / split


def _is_split(directory: TreePath) -> bool:
    return all((directory / name).is_dir() for name in _TRAVERSES)


def _frames(directory: TreePath, names: dict[str, str], shift: dict[int, float], timed: bool) -> Iterator[ForeignFrame]:
    for (stem, name), content in read_files(directory, {name: (stem, name) for stem, name in names.items()}):
        place = _place(directory, name)
        east = place.east + (0.0 if place.zone is None else shift[place.zone])
        pose = Pose(east, place.north, place.heading)
        yield ForeignFrame(stem, content, pose, place.seconds if timed else None)


def _place(directory: TreePath, name: str) -> _Place:
    parts = name.rpartition("/")[2].split("@")
    if parts[0] or len(parts) < 4:
        raise RouteError(
            f"the name of {readable(directory / name)} is not of the form @UTM_east@UTM_north@...@.jpg; rename it or "
            "move it away"
        )
    complete = len(parts) == _COMPLETE
    zone = parts[_ZONE].strip() if complete else ""
    heading = parts[_HEADING].strip() if complete else ""
    return _Place(
        zone=round(_number(directory, name, "UTM zone", zone)) if zone else None,
        east=_number(directory, name, "UTM east", parts[_EAST]),
        north=_number(directory, name, "UTM north", parts[_NORTH]),
        heading=math.radians((90.0 - _number(directory, name, "heading", heading)) % 360.0) if heading else 0.0,
        seconds=_seconds(parts[_TIME]) if complete else None,
    )


def _number(directory: TreePath, name: str, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < 1e9:
        raise RouteError(
            f"the name of {readable(directory / name)} holds {text!r} as its {what}, which is no such number; "
            "correct it"
        )
    return value


def _seconds(text: str) -> float | None:
    """Reads YYYYMMDD_hhmmss; anything shorter is no moment."""
    try:
        return datetime.strptime(text, "%Y%m%d_%H%M%S").replace(tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None
