"""Writes the frames of a source into a route's directory, with the tables of their poses and times."""

from __future__ import annotations

import csv
import stat
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from everplace.errors import RouteError, StorageError
from everplace.files import readable
from everplace.images.decoding import IMAGE_ENDINGS, read_image_bytes
from everplace.images.sixteen_bits import SixteenBits
from everplace.importing.foreign_route import Content, Encoded, ForeignFrame, ForeignTraverse
from everplace.importing.frame_pixels import without_16_bits
from everplace.progress import Progress
from everplace.route.folder import POSES_CSV, TIMES_CSV
from everplace.route.natural_order import natural_sorted
from everplace.route.truth import TruthPair

__all__ = ["RouteWriter", "reading", "unreadable"]

_LONGEST_NAME = 255  # bytes, on every usual file system


class RouteWriter:
    """Writes traverses into a route's directory.

    Attributes:
        traverses: Number of frames by name.
        conditions: Condition by name.
        linked: Number of frames that are links.
        notes: What the frames showed that the user should know.
        links: Why files were copied although links were wanted; None: they were not.
    """

    def __init__(self, directory: Path, copy: bool) -> None:
        self.traverses: dict[str, int] = {}
        self.conditions: dict[str, str] = {}
        self.linked = 0
        self._stems: dict[str, set[str]] = {}
        self.notes: list[str] = []
        self.links: str | None = None
        self._directory = directory
        self._copy = copy
        self._device = directory.stat().st_dev

    def write(self, traverse: ForeignTraverse, source: Path, progress: Progress) -> None:
        """Writes one traverse with its poses and times."""
        name = traverse.name
        _check_name("traverse", name, name, source)
        if name in self.traverses:
            raise RouteError(f"{readable(source)} gives two traverses of the name {name!r}; rename one of them")
        directory = self._directory / name
        directory.mkdir()
        stems: set[str] = set()
        poses = _Table("pose", ("x", "y", "heading"))
        times = _Table("time", ("seconds",))
        scale: SixteenBits | None = None
        for frame in progress(reading(traverse.frames, source), f"importing {name}", traverse.count):
            where = f"the frame {frame.stem!r} of the traverse {name!r}"
            if frame.stem in stems:
                raise RouteError(f"{readable(source)} gives {where} twice; keep one of the two")
            self._write_frame(directory, frame, source, where)
            where = f"{where} of {readable(source)}"
            poses.add(frame.stem, frame.pose, len(stems), where)
            times.add(frame.stem, None if frame.seconds is None else (frame.seconds,), len(stems), where)
            stems.add(frame.stem)
            scale = frame.scale
        poses.write(directory / POSES_CSV)
        times.write(directory / TIMES_CSV)
        if not stems:
            raise RouteError(f"the traverse {name!r} of {readable(source)} has no frame; leave it out")
        if scale is not None:
            self.notes += scale.notes(readable(name))
        self._stems[name] = stems
        self.traverses[name] = len(stems)
        self.conditions[name] = traverse.condition or name

    def known_pairs(self, pairs: Iterator[TruthPair], source: Path) -> Iterator[TruthPair]:
        """Passes on pairs of frames that were written; another one is an error that names it."""
        for pair in pairs:
            for traverse, stem in (pair[:2], pair[2:]):
                if stem not in self._stems.get(traverse, ()):
                    raise RouteError(
                        f"the ground truth of {readable(source)} names the frame {stem!r} of {traverse!r}, which "
                        "it does not have; complete the images or correct it"
                    )
            yield pair

    def _write_frame(self, directory: Path, frame: ForeignFrame, source: Path, where: str) -> None:
        ending = _ending(frame.content)
        if ending.lower() not in IMAGE_ENDINGS:
            raise RouteError(
                f"{where} of {readable(source)} ends in {ending!r}, which is no image; "
                f"convert it to one of {', '.join(sorted(IMAGE_ENDINGS))}"
            )
        content = without_16_bits(frame)
        ending = _ending(content)
        _check_name("frame", frame.stem, frame.stem + ending, source)
        target = directory / (frame.stem + ending)
        if isinstance(content, Path):
            self._link_or_copy(content, target)
        elif isinstance(content, Encoded):
            target.write_bytes(content.data)
        else:
            target.write_bytes(_png(content))

    def _link_or_copy(self, file: Path, target: Path) -> None:
        if not self._copy and self._device == _device(file):
            try:
                target.symlink_to(file.absolute())
                self.linked += 1
                return
            except (OSError, NotImplementedError):
                self._copy = True
                self.links = "The images were copied: links are not possible where the route lies."
        elif not self._copy:
            self.links = "Images were copied: the source lies on another disk than the route."
        target.write_bytes(read_image_bytes(file))


class _Table:
    """Numbers of the frames of a traverse: all of them have some, or none has."""

    def __init__(self, what: str, columns: tuple[str, ...]) -> None:
        self._what, self._columns = what, columns
        self._stems: list[str] = []
        self._values = array("d")

    def add(self, stem: str, values: tuple[float, ...] | None, before: int, where: str) -> None:
        """Adds a frame, the `before`-th of its traverse."""
        if before and (values is None) == bool(self._stems):
            raise RouteError(
                f"{where} has {'no' if values is None else 'a'} {self._what}, unlike those before it; give all frames "
                f"of a traverse a {self._what}, or none"
            )
        if values is None:
            return
        if not np.isfinite(values).all():
            raise RouteError(f"the {self._what} of {where} is not finite; correct it or leave the frame out")
        self._stems.append(stem)
        self._values.extend(values)

    def write(self, path: Path) -> None:
        """Writes a CSV file, if there are numbers, in the order of a route: an archive gives frames in its own."""
        if not self._stems:
            return
        row = {stem: index for index, stem in enumerate(self._stems)}
        values = np.frombuffer(self._values).reshape(-1, len(self._columns))
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("stem", *self._columns))
            writer.writerows([stem, *map(repr, values[row[stem]].tolist())] for stem in natural_sorted(self._stems))


def reading(items: Iterator[Any], source: Path) -> Iterator[Any]:
    """Passes on what a source gives; a failure of its disk is not one of ours."""
    try:
        yield from items
    except OSError as error:
        raise unreadable(error, source) from error


def unreadable(error: OSError, source: Path) -> RouteError:
    """Returns what to say of a source's file that the system cannot read."""
    return RouteError(f"cannot read {readable(error.filename or source)}: {error.strerror or error}; check the source")


def _check_name(what: str, name: str, file_name: str, source: Path) -> None:
    """Raises `RouteError` for a name that cannot be a file's everywhere, or would hide it."""
    problem = None
    if not name or name.startswith("."):
        problem = "is empty or hidden"
    elif any(letter in "/\\" or ord(letter) < 32 or ord(letter) == 127 for letter in name):
        problem = "holds a path separator or a control character"
    elif any("\ud800" <= letter <= "\udfff" for letter in name):
        problem = "is not UTF-8"
    elif len(file_name.encode("utf-8")) > _LONGEST_NAME:
        problem = f"is longer than {_LONGEST_NAME} bytes with its ending"
    if problem is not None:
        raise RouteError(f"{readable(source)} gives a {what} the name {name!a}, which {problem}; rename it")


def _ending(content: Content) -> str:
    if isinstance(content, Path):
        return content.suffix
    return content.ending if isinstance(content, Encoded) else ".png"


def _device(file: Path) -> int:
    """Returns the disk on which a file lies."""
    try:
        status = file.stat()
    except OSError as error:
        raise RouteError(f"cannot read {readable(file)}: {error.strerror or error}; check the source") from error
    if not stat.S_ISREG(status.st_mode):
        raise RouteError(f"{readable(file)} is not a regular file; move it out of the source")
    return status.st_dev


def _png(pixels: np.ndarray[Any, np.dtype[np.uint8]]) -> bytes:
    done, data = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.shape[2] == 3 else pixels)
    if not done:
        raise StorageError(f"cannot encode a picture of {pixels.shape[1]}×{pixels.shape[0]} pixels as PNG")
    return data.tobytes()
