"""One drive in several files: chapters of a camera, bags that were split while they were recorded.

Which files of a directory are one drive the user says with `join`; where their names look like parts of one drive and
nothing was said, a note tells.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.recording import RecordingOptions
from everplace.route.natural_order import natural_key, natural_sorted

__all__ = ["PartOptions", "Recording", "find_recordings", "split_drives"]

# GoPro: GX010012, GX020012 are the chapters 1 and 2 of the video 0012; older cameras begin with GOPR0012, GP010012.
_CHAPTER = re.compile(r"G[A-Z]([0-9]{2})([0-9]{4})")
_FIRST_CHAPTER = re.compile(r"GOPR([0-9]{4})")
# `rosbag record --split` and `ros2 bag record` count from 0; the former may put another time before each number.
_PART = re.compile(r"(.*)_([0-9]{1,6})")
_DIGITS = re.compile("[0-9]+")


def _join(value: object) -> object:
    """Lets true and false stand for all files and none."""
    if isinstance(value, list) and [str(name).lower() for name in value] in (["true"], ["false"]):
        value = value[0].lower() == "true"
    if isinstance(value, bool):
        return ("true",) if value else ()
    return value


class PartOptions(RecordingOptions):
    """Options of recordings that may come in several files."""

    join: Annotated[tuple[str, ...], BeforeValidator(_join)] = ()
    """true makes one drive of all files of a directory, in natural order, or of those of each directory in it; names of
    files, separated by commas, make one drive of these, in this order. By default each file is a drive."""


@dataclass(frozen=True)
class Recording:
    """One drive.

    Attributes:
        name: What its traverse will be called.
        parts: The files that hold it, in order; a ROS 2 bag is a directory.
    """

    name: str
    parts: tuple[Path, ...]


def find_recordings(
    source: Path, join: Sequence[str], listed: Callable[[Path], list[str]], *, whole: bool = False
) -> tuple[list[Recording], list[str]]:
    """Finds the drives of a source.

    Args:
        source: One recording, or a directory of them.
        join: The option.
        listed: Returns the names of the recordings that lie in a directory, in natural order.
        whole: The source is one recording, though it may be a directory.

    Returns:
        The drives, none where there is no recording, and sentences for the user.

    Raises:
        ConfigError: `join` names a file that is not there, or one twice.
        RouteError: A directory cannot be listed.
    """
    everything = list(join) == ["true"]
    if whole or not source.is_dir():
        if join and not everything:
            raise ConfigError(f"`join` names files of a directory, and {readable(source)} is one recording")
        return [_recording(source)], [] if whole else _more_parts(source, listed)
    names = listed(source)
    if not join:
        return [_recording(source / name) for name in names], _split_note(source, names)
    if not everything:
        return _named_parts(source, join, names)
    if names:
        return [_joined(source, names)], []
    found = [source / name for name in TreePath(source).children().directories]
    return [_joined(place, inside) for place in found if (inside := listed(place))], []


def split_drives(names: Sequence[str]) -> list[list[str]]:
    """Returns the files whose names look like parts of one drive, each drive's in their order.

    These are chapters of a video by GoPro's cameras (`GX010012.MP4`, `GX020012.MP4`), and names that end in numbers
    from 0 on and otherwise differ by digits at most, as rosbag splits (`drive_0.bag`, `drive_1.bag`).

    Args:
        names: Files in a directory.
    """
    chapters: dict[tuple[str, ...], list[str]] = {}
    runs: list[list[str]] = []
    last: tuple[str, int] | None = None
    for name in _in_order(names):
        stem, _, ending = name.rpartition(".") if "." in name else (name, "", "")
        if (number := _video_number(stem)) is not None:
            chapters.setdefault((number, ending.lower()), []).append(name)
        elif (match := _PART.fullmatch(stem)) is not None:
            kind, count = _DIGITS.sub("0", f"{match[1]}.{ending.lower()}"), int(match[2])
            if count == 0:
                runs.append([name])
            elif runs and last == (kind, count - 1):
                runs[-1].append(name)
            else:
                continue
            last = kind, count
    return [group for group in (*chapters.values(), *runs) if len(group) > 1]


def _in_order(names: Sequence[str]) -> list[str]:
    """Sorts the parts of a drive; chapters come after those of the video before, though their number comes first."""
    stems = {name: name.rpartition(".")[0] or name for name in names}
    numbers = {name: _video_number(stem) for name, stem in stems.items()}
    if all(number is not None for number in numbers.values()):
        return sorted(names, key=lambda name: (numbers[name], natural_key(stems[name])))
    return natural_sorted(names)


def _video_number(stem: str) -> str | None:
    """Returns the number of the video of which a file is a chapter; None: it is not named like one."""
    if (match := _CHAPTER.fullmatch(stem.upper())) is not None:
        return match[2]
    match = _FIRST_CHAPTER.fullmatch(stem.upper())
    return None if match is None else match[1]


def _recording(path: Path) -> Recording:
    return Recording(path.absolute().name if path.is_dir() else path.stem, (path,))


def _joined(directory: Path, names: Sequence[str]) -> Recording:
    return Recording(directory.absolute().name, tuple(directory / name for name in _in_order(names)))


def _named_parts(source: Path, join: Sequence[str], names: Sequence[str]) -> tuple[list[Recording], list[str]]:
    if len(set(join)) < len(join):
        raise ConfigError("`join` names a file twice; give each part of the drive once")
    for name in join:
        if name not in names:
            offer = ", ".join(map(readable, names)) or "none"
            raise ConfigError(
                f"`join` names {readable(name)!r}, which is no recording in {readable(source)}; there are: {offer}"
            )
    others = [name for name in names if name not in join]
    parts = tuple(source / name for name in join)
    notes = [f"Recordings that join does not name were not read: {', '.join(map(readable, others))}."] if others else []
    return [Recording(source.absolute().name, parts)], notes


def _split_note(source: Path, names: Sequence[str]) -> list[str]:
    groups = split_drives(names)
    if not groups:
        return []
    first, second, *_ = groups[0]
    if len(groups) == 1 and len(groups[0]) == len(names):
        remedy = "if they are, import with `join=true`"
    else:
        remedy = "if they are, put the parts of each drive into a directory of its own and import with `join=true`"
    return [
        f"{readable(first)} and {readable(second)} in {readable(source)} look like parts of one drive, but each became "
        f"a drive of its own; {remedy}."
    ]


def _more_parts(source: Path, listed: Callable[[Path], list[str]]) -> list[str]:
    """Says that a file which was given by itself looks like a part of a drive."""
    directory = source.absolute().parent
    try:
        groups = split_drives(listed(directory))
    except RouteError:  # a file may be read where its directory may not be listed
        return []
    group = next((group for group in groups if source.name in group), None)
    if group is None:
        return []
    return [
        f"{readable(source)} looks like one of {len(group)} parts of a drive, and the others were not read; if it is, "
        f"give the directory and `join={readable(','.join(group))}`."
    ]
