"""Turns what a source gives into a route: `import_route("nordland", source, out, {"preset": "olid"})`.

The route appears whole or not at all. Frames are handled one by one; files that can stay where they are become
symbolic links.
"""

from __future__ import annotations

import contextlib
import csv
import io
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

from everplace.data.images import IMAGE_ENDINGS, read_image_bytes
from everplace.data.kinds import open_kind, read_options
from everplace.data.route_toml import ROUTE_TOML
from everplace.data.sources.folder import POSES_CSV, TIMES_CSV
from everplace.data.sources.protocol import Content, Encoded, ForeignFrame, ForeignRoute, ForeignTraverse
from everplace.data.truth import TRUTH_CSV, TruthPair, write_truth
from everplace.errors import RouteError, StorageError
from everplace.files import readable, require_free_directory, whole_directory
from everplace.progress import Progress, quiet

__all__ = ["ImportSummary", "import_route", "write_route"]

_LONGEST_NAME = 255  # bytes, on every usual file system


@dataclass(frozen=True)
class ImportSummary:
    """What was imported.

    Attributes:
        traverses: Number of frames of each traverse, in the order of import.
        linked: Number of frames that are links to the source's own files.
        tolerance: Frames by which a match may be off, if the source says so.
        radius: Metres by which a match may be off, if it says so.
        protocol: The published protocol that chose the frames; empty: none.
        notes: Sentences that the user should read.
    """

    traverses: Mapping[str, int]
    linked: int
    tolerance: int | None
    radius: float | None
    protocol: str
    notes: tuple[str, ...]

    @property
    def frames(self) -> int:
        """The number of frames of all traverses."""
        return sum(self.traverses.values())


def import_route(
    kind: str,
    source: Path,
    out: Path,
    options: Mapping[str, str] | None = None,
    *,
    copy: bool = False,
    progress: Progress = quiet,
) -> ImportSummary:
    """Reads a source of some kind and writes it as a route.

    A frame that is a file of its own becomes a symbolic link to it, unless it lies on another disk, links are not
    possible in the target, or `copy` is set; other frames are written as they come, pixels as PNG.

    Args:
        kind: A name that `kinds.source_kinds` lists.
        source: What to read.
        out: The route's directory; it must not exist, or be empty.
        options: The kind's options as text, lists with commas.
        copy: Copy files instead of linking to them.
        progress: Shows how far it has come.

    Raises:
        ConfigError: `out` exists and is not an empty directory; the kind or one of its options does not exist, or
            has a value that cannot be.
        RouteError: The source is missing, damaged or not of this kind; two traverses have one name, two frames of a
            traverse one stem; a name cannot be a file's; some frames of a traverse have a pose or time and others
            none.
        ImageError: A file of the source cannot be read.
        StorageError: The route cannot be written; nothing is left behind.
    """
    opened = open_kind(kind)
    settings = read_options(kind, opened.Options, options or {})
    require_free_directory(out)
    if not source.exists():
        raise RouteError(f"the source {readable(source)} does not exist; check the path")
    try:
        route = opened.read(source, settings)
    except OSError as error:
        raise _unreadable(error, source) from error
    return write_route(route, source, out, f"Imported with everplace data import {kind}.", copy=copy, progress=progress)


def write_route(
    route: ForeignRoute,
    source: Path,
    out: Path,
    origin: str,
    *,
    copy: bool = False,
    files: Mapping[str, str] | None = None,
    progress: Progress = quiet,
) -> ImportSummary:
    """Writes what a source gives as a route; frames that are files become links, as `import_route` says.

    Args:
        route: What to write.
        source: What it came from, for messages.
        out: The route's directory; it must not exist, or be empty.
        origin: A sentence that says where the route comes from, for whoever finds it later.
        copy: Copy files instead of linking to them.
        files: Texts to write beside the traverses, by file name.
        progress: Shows how far it has come.

    Raises:
        ConfigError, RouteError, ImageError, StorageError: As for `import_route`.
    """
    require_free_directory(out)
    with whole_directory(out) as directory:
        writer = _Writer(directory, copy)
        for traverse in _reading(route.traverses, source):
            writer.write(traverse, source, progress)
        if not writer.traverses:
            raise RouteError(f"{readable(source)} holds no traverse of this kind; check the path and the kind")
        if route.truth is not None:
            write_truth(directory / TRUTH_CSV, writer.known_pairs(_reading(route.truth, source), source))
        text = _route_toml(origin, route, writer.conditions)
        for name, content in {**(files or {}), ROUTE_TOML: text}.items():
            (directory / name).write_text(content, encoding="utf-8")
        if out.is_dir():
            out.rmdir()  # it was empty; a rename onto it would fail on Windows
    notes = route.notes if writer.links is None else (*route.notes, writer.links)
    return ImportSummary(writer.traverses, writer.linked, route.tolerance, route.radius, route.protocol, notes)


class _Writer:
    """Writes traverses into a route's directory.

    Attributes:
        traverses: Number of frames by name.
        conditions: Condition by name.
        linked: Number of frames that are links.
        links: Why files were copied although links were wanted; None: they were not.
    """

    def __init__(self, directory: Path, copy: bool) -> None:
        self.traverses: dict[str, int] = {}
        self.conditions: dict[str, str] = {}
        self.linked = 0
        self._stems: dict[str, set[str]] = {}
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
        with (
            contextlib.closing(_Table(directory / POSES_CSV, ("stem", "x", "y", "heading"))) as poses,
            contextlib.closing(_Table(directory / TIMES_CSV, ("stem", "seconds"))) as times,
        ):
            frames = _reading(traverse.frames, source)
            for frame in progress(frames, f"importing {name}", traverse.count):
                where = f"the frame {frame.stem!r} of the traverse {name!r}"
                if frame.stem in stems:
                    raise RouteError(f"{readable(source)} gives {where} twice; keep one of the two")
                self._write_frame(directory, frame, source, where)
                poses.add(frame.stem, frame.pose, len(stems), f"{where} of {readable(source)}", "pose")
                seconds = None if frame.seconds is None else (frame.seconds,)
                times.add(frame.stem, seconds, len(stems), f"{where} of {readable(source)}", "time")
                stems.add(frame.stem)
        if not stems:
            raise RouteError(f"the traverse {name!r} of {readable(source)} has no frame; leave it out")
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
        content = frame.content
        ending = _ending(content)
        if ending.lower() not in IMAGE_ENDINGS:
            raise RouteError(
                f"{where} of {readable(source)} ends in {ending!r}, which is no image; "
                f"convert it to one of {', '.join(sorted(IMAGE_ENDINGS))}"
            )
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
    """A CSV file of numbers by stem, which exists once a frame has some."""

    def __init__(self, path: Path, columns: tuple[str, ...]) -> None:
        self._path, self._columns = path, columns
        self._file: io.TextIOWrapper | None = None

    def add(self, stem: str, values: tuple[float, ...] | None, before: int, where: str, what: str) -> None:
        """Adds a frame, the `before`-th of its traverse, or checks that none before had values either."""
        if (values is None) == (self._file is not None) and before:
            raise RouteError(
                f"{where} has {'no' if values is None else 'a'} {what}, unlike those before it; give all frames "
                f"of a traverse a {what}, or none"
            )
        if values is None:
            return
        if not np.isfinite(values).all():
            raise RouteError(f"the {what} of {where} is not finite; correct it or leave the frame out")
        if self._file is None:
            self._file = self._path.open("w", encoding="utf-8", newline="")
            csv.writer(self._file).writerow(self._columns)
        csv.writer(self._file).writerow([stem, *map(repr, map(float, values))])

    def close(self) -> None:
        """Closes the file, if there is one."""
        if self._file is not None:
            self._file.close()


def _reading(items: Iterator[Any], source: Path) -> Iterator[Any]:
    """Passes on what a source gives; a failure of its disk is not one of ours. Closes it in the end."""
    try:
        while True:
            try:
                item = next(items)
            except StopIteration:
                return
            except OSError as error:
                raise _unreadable(error, source) from error
            yield item
    finally:
        close = getattr(items, "close", None)
        if close is not None:
            close()


def _unreadable(error: OSError, source: Path) -> RouteError:
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


def _route_toml(origin: str, route: ForeignRoute, conditions: Mapping[str, str]) -> str:
    """Writes what directories cannot say, and the notes as comments for whoever finds the route later."""
    table: dict[str, Any] = {} if route.aligned else {"aligned": False}
    if route.tolerance is not None:
        table["tolerance"] = route.tolerance
    if route.radius is not None:
        table["radius"] = float(route.radius)
    if route.truth is not None:
        table["truth"] = TRUTH_CSV
    if route.protocol:
        table["protocol"] = route.protocol
    differing = {name: {"condition": condition} for name, condition in conditions.items() if condition != name}
    if differing:
        table["traverses"] = differing
    comments = [origin, *route.notes]
    return "".join(f"# {' '.join(note.split())}\n" for note in comments) + tomli_w.dumps(table)
