"""Names of Nordland frames: the season and the stem that a path tells, and lists of such paths."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.importing.foreign_route import ForeignFrame

__all__ = ["SEASONS", "Copy", "Named", "at_frame", "olid_frame", "olid_stem", "read_list", "season_frame", "season_of"]

SEASONS = ("spring", "summer", "fall", "winter")

_SEASON_WORDS = {
    "spring": "spring", "summer": "summer", "fall": "fall", "autumn": "fall", "winter": "winter",
    "vår": "spring", "vaar": "spring", "sommer": "summer", "høst": "fall", "hoest": "fall", "vinter": "winter",
}  # fmt: skip
_SEASON = re.compile(rf"(?<![a-zæøå])({'|'.join(_SEASON_WORDS)})(?![a-zæøå])")
_OLID = re.compile(r"(?:^|/)([a-z]+)_images_(train|test)/section([0-9]{1,6})/([0-9]{1,9})\.[A-Za-z]+$")
_AT = re.compile(r"(?:^|/)(database|queries)/@[^/]*$")
_AT_NUMBER = 7  # @0@north@@@@@number@@@@@@@@.jpg
_LARGEST_LIST = 2**26
_SURROGATES = (0xD800, 0xDFFF)


class Named(NamedTuple):
    """What a path tells about a frame.

    Attributes:
        season: One of `SEASONS`, or the directory's name in the `@`-naming; empty: not told.
        stem: The frame's stem in the route.
        split: `train` or `test` in the Olid partition, else empty.
        north: Made-up metres along the way in the `@`-naming, else 0.
    """

    season: str
    stem: str
    split: str = ""
    north: float = 0.0


@dataclass
class Copy:
    """A copy of the data set, whatever its form.

    Attributes:
        stems: The frames of each season.
        read: Reads some frames of a season, in an order that suits the copy.
        tolerance: Frames by which a match may be off, if the copy tells.
        notes: Sentences for the user.
    """

    stems: dict[str, list[str]]
    read: Callable[[str, Sequence[str]], Iterator[ForeignFrame]]
    tolerance: int | None = None
    notes: tuple[str, ...] = ()


def season_of(text: str) -> str:
    """Returns the season that a name speaks of in English or Norwegian, or nothing."""
    found = _SEASON.findall(text.lower())
    return _SEASON_WORDS[found[-1]] if found else ""


def season_frame(path: str) -> Named:
    """Reads `.../<season>/.../images-00001.png`: the nearest directory that names a season counts."""
    *directories, name = path.split("/")
    season = next(filter(None, map(season_of, reversed(directories))), "")
    return Named(season, name.rpartition(".")[0] or name)


def olid_frame(path: str) -> Named | None:
    """Reads `{train,test}/<season>_images_<split>/section<k>/<n>.png`; None: it is not of this form.

    Train and test count from 0 each, so both and the section are part of the stem.
    """
    match = _OLID.search(path)
    if match is None or match[1] not in SEASONS:
        return None
    return Named(match[1], olid_stem(match[2], int(match[3]), int(match[4])), match[2])


def olid_stem(split: str, section: int, number: int) -> str:
    """Returns the stem of a frame of the Olid partition."""
    return f"{split}-{section}-{number:05d}"


def at_frame(path: str) -> Named | None:
    """Reads `{database,queries}/@0@<north>@@@@@<n>@@@@@@@@.jpg`; None: it is not of this form."""
    match = _AT.search(path)
    fields = path.rpartition("/")[2].split("@")
    if match is None or len(fields) <= _AT_NUMBER or not re.fullmatch("[0-9]{1,9}", fields[_AT_NUMBER]):
        return None
    try:
        north = float(fields[2])
    except ValueError:
        return None
    return Named(match[1], f"{int(fields[_AT_NUMBER]):05d}", north=north)


def read_list(path: Path) -> list[Named]:
    """Reads a list of frames: a text file with a path in each line, or an `.npy` array of such texts.

    Names count, positions never do: `images-00001.png`, `winter/images-00001.png`, or a path of the Olid partition.
    A season in the name of the list holds for the lines without one.

    Raises:
        RouteError: It cannot be read, is empty, holds something else than names, or a name twice.
    """
    try:
        if path.stat().st_size > _LARGEST_LIST:
            raise RouteError(f"the list {readable(path)} has more than {_LARGEST_LIST} bytes; give a list of names")
        lines = _npy_lines(path) if path.suffix.lower() == ".npy" else path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise RouteError(f"the list {readable(path)} is not UTF-8 text; save it with one name in each line") from error
    except OSError as error:
        raise RouteError(f"cannot read the list {readable(path)}: {error.strerror or error}; check `list`") from error
    frames = list(_named(lines, season_of(path.stem)))
    if not frames:
        raise RouteError(f"the list {readable(path)} names no frame; it must hold one name in each line")
    seen: set[Named] = set()
    for frame in frames:
        if frame in seen:
            where = f" of {frame.season}" if frame.season else ""
            raise RouteError(f"the list {readable(path)} names {frame.stem!a}{where} twice; keep one of the two")
        seen.add(frame)
    return frames


def _named(lines: Iterable[str], season: str) -> Iterable[Named]:
    for line in lines:
        text = line.strip().replace("\\", "/")
        if text and not text.startswith("#"):
            frame = olid_frame(text) or season_frame(text)
            yield frame if frame.season else frame._replace(season=season)


def _npy_lines(path: Path) -> list[str]:
    refuse_pointer(path, RouteError)
    try:
        # Mapped, so that a header that claims to be huge takes no memory.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        lines: list[str] = []
        if array.dtype.kind == "U":
            # NumPy makes texts of any four bytes, and Python crashes on those that are no character.
            codes = np.frombuffer(array.tobytes(), dtype=np.dtype(np.uint32).newbyteorder(array.dtype.byteorder))
            if ((codes > sys.maxunicode) | ((codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1]))).any():
                raise ValueError("it holds codes that are no characters")
            lines = [str(text) for text in array.ravel()]
        if array.dtype.kind == "S":
            lines = [bytes(text).decode("utf-8") for text in array.ravel()]
    except UnicodeDecodeError:
        raise
    except OSError as error:
        if error.errno is not None:
            raise
        raise RouteError(f"the list {readable(path)} is truncated or no .npy file; save it again") from error
    except Exception as error:  # whatever a broken header makes NumPy raise
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RouteError(
            f"the list {readable(path)} is no .npy array of texts ({reason}); save it as text, one name in each line"
        ) from error
    if array.size and not lines:
        raise RouteError(
            f"the list {readable(path)} holds {array.dtype}, not names; frames are joined by name, never by position"
        )
    return lines
