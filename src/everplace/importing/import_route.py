"""Turns what a source gives into a route: `import_route("nordland", source, out, {"preset": "olid"})`.

The route appears whole or not at all. Frames are handled one by one; files that can stay where they are become
symbolic links.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from everplace.errors import RouteError
from everplace.files import readable, require_free_directory, whole_directory
from everplace.importing.foreign_route import ForeignRoute, ScaledOptions
from everplace.importing.frame_pixels import scaled
from everplace.importing.kinds import open_kind, read_options
from everplace.importing.route_writer import RouteWriter, reading, unreadable
from everplace.progress import Progress, quiet
from everplace.route.route_toml import ROUTE_TOML
from everplace.route.truth import TRUTH_CSV, write_truth

__all__ = ["ImportSummary", "import_route", "write_route"]


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
        raise unreadable(error, source) from error
    if isinstance(settings, ScaledOptions):
        traverses = (replace(one, frames=scaled(one.frames, settings.scale())) for one in route.traverses)
        route = replace(route, traverses=traverses)
    origin = f"Imported with everplace data import {kind}."
    return write_route(route, source, out, origin, copy=copy, progress=progress)


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
        writer = RouteWriter(directory, copy)
        for traverse in reading(route.traverses, source):
            writer.write(traverse, source, progress)
        if not writer.traverses:
            raise RouteError(f"{readable(source)} holds no traverse of this kind; check the path and the kind")
        if route.truth is not None:
            write_truth(directory / TRUTH_CSV, writer.known_pairs(reading(route.truth, source), source))
        notes = (*route.notes, *writer.notes)
        text = _route_toml([origin, *notes], route, writer.conditions)
        for name, content in {**(files or {}), ROUTE_TOML: text}.items():
            (directory / name).write_text(content, encoding="utf-8")
        if out.is_dir():
            out.rmdir()  # it was empty; a rename onto it would fail on Windows
    if writer.links is not None:
        notes = (*notes, writer.links)
    return ImportSummary(writer.traverses, writer.linked, route.tolerance, route.radius, route.protocol, notes)


def _route_toml(comments: Sequence[str], route: ForeignRoute, conditions: Mapping[str, str]) -> str:
    """Writes what directories cannot say, and comments for whoever finds the route later."""
    table: dict[str, Any] = {} if route.aligned else {"aligned": False}
    if route.tolerance is not None:
        table["tolerance"] = route.tolerance
    if route.radius is not None:
        table["radius"] = float(route.radius)
    if route.truth is not None:
        table["truth"] = TRUTH_CSV
    said = {"truth_from": route.truth_from, "aligned_by": route.aligned_by, "protocol": route.protocol}
    table |= {name: text for name, text in said.items() if text}
    differing = {name: {"condition": condition} for name, condition in conditions.items() if condition != name}
    if differing:
        table["traverses"] = differing
    return "".join(f"# {' '.join(note.split())}\n" for note in comments) + tomli_w.dumps(table)
