"""Writes an aligned route: links to the images, what is known of them, and a table of the stems."""

from __future__ import annotations

import csv
import io
import os
import warnings
from collections.abc import Iterator
from pathlib import Path

from everplace.alignment.align import (
    Alignment,
    align_by_images,
    align_by_pairs,
    align_by_poses,
    alignment_figure,
    judge,
)
from everplace.choices import AlignedBy
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, RouteError
from everplace.files import readable, require_free_directory
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse
from everplace.importing.import_route import ImportSummary, write_route
from everplace.plots.canvas import save_figure
from everplace.progress import Progress, quiet
from everplace.route.csv_table import read_times
from everplace.route.folder import TIMES_CSV
from everplace.route.route import Route, Traverse, open_route
from everplace.route.truth import TruthPair, TruthTable

__all__ = ["ALIGNMENT_CSV", "align", "write_aligned"]

ALIGNMENT_CSV = "alignment.csv"
"""In an aligned route: which frame of each drive became which stem."""


def align(
    route: Route,
    out: str | os.PathLike[str],
    *,
    by: AlignedBy = "images",
    method: str = "hog",
    pairs: str | os.PathLike[str] | None = None,
    reference: str | None = None,
    radius: float | None = None,
    picture: str | os.PathLike[str] | None = None,
    progress: Progress = quiet,
) -> Route:
    """Writes a route in which the same stem means the same place, and opens it.

    What must be said of it, such as drives that hardly agree, is a `UserWarning`.

    Args:
        route: The drives, aligned or not.
        out: The new route, a directory that does not exist or is empty.
        by: What tells the same places.
        method: Describes the images, for `by="images"`.
        pairs: A CSV file of frames that show the same place, for `by="pairs"`.
        reference: The traverse whose stems are kept; None: the one with the fewest frames.
        radius: Metres between two frames of a place, for `by="poses"`.
        picture: A file (.png, .svg, .pdf) that shows the similarity of the drives and the path found; None: none.
        progress: Told of describing and writing.

    Raises:
        ConfigError: The arguments do not go together, or `out` is not free.
        RouteError: The drives cannot be aligned so.
        MethodError: There is no such method.
        StorageError: `out` cannot be written to.
    """
    if (by == "pairs") != (pairs is not None):
        raise ConfigError("`by=pairs` and `pairs` go together; give both or none of them")
    if radius is not None and by != "poses":
        raise ConfigError(f"`radius` is of no use with `by={by}`; leave it out")
    require_free_directory(Path(out))
    if by == "images":
        alignment = align_by_images(route, open_describer(method), reference, progress)
    elif pairs is not None:
        alignment = align_by_pairs(route, Path(pairs), reference)
    else:
        alignment = align_by_poses(route, reference, radius)
    if picture is not None:
        if not alignment.paths:
            alignment = judge(alignment, open_describer(method), progress)
        save_figure(alignment_figure(alignment), Path(picture))
    written = write_aligned(alignment, Path(out), progress)
    for sentence in (*alignment.warnings, *written.notes):
        warnings.warn(sentence, stacklevel=2)
    return open_route(out)


def write_aligned(alignment: Alignment, out: Path, progress: Progress = quiet) -> ImportSummary:
    """Writes an aligned route: links to the images under the reference's stems, what is known of them, and a table.

    Poses, times, conditions, tolerance, radius and protocol come along. So does a file of pairs, under the new stems;
    a note says how many pairs are left out because a frame of theirs is. Where neither a radius nor pairs tell the same
    places, the truth comes from this alignment, and the route says so.

    Args:
        alignment: What to write.
        out: The route's directory; it must not exist, or be empty.
        progress: Shows how far it has come.

    Raises:
        ConfigError: `out` exists and is not an empty directory.
        RouteError: Times or a file of pairs are wrong, or no pair of the file is left.
        StorageError: The route cannot be written; nothing is left behind.
    """
    route = alignment.route
    stems = route[alignment.reference].take(alignment.frames[alignment.reference]).stems

    def traverses() -> Iterator[ForeignTraverse]:
        for traverse in route.traverses:
            chosen = traverse.take(alignment.frames[traverse.name])
            yield ForeignTraverse(traverse.name, _frames(chosen, stems), traverse.condition, len(chosen))

    pairs, notes = (None, ()) if route.truth is None else _renamed_pairs(alignment, route.truth, stems)
    foreign = ForeignRoute(
        traverses(), route.tolerance, route.radius,
        truth=None if pairs is None else iter(pairs), notes=notes, protocol=route.protocol or "",
        truth_from=f"an alignment by {alignment.how}" if route.matched_by_stem else route.truth_origin or "",
        aligned_by=alignment.method,
    )  # fmt: skip
    origin = f"Aligned with {alignment.reference} by {alignment.how}; see {ALIGNMENT_CSV}."
    return write_route(
        foreign, route.root, out, origin, files={ALIGNMENT_CSV: _table(alignment, stems)}, progress=progress
    )


def _frames(traverse: Traverse, stems: tuple[str, ...]) -> Iterator[ForeignFrame]:
    path = traverse.root / TIMES_CSV
    times = read_times(path, traverse.stems).tolist() if path.exists() else [None] * len(traverse)
    for stem, frame, seconds in zip(stems, traverse, times, strict=True):
        # A link to a link would break with the route in between.
        yield ForeignFrame(stem, frame.path.resolve(), frame.pose, seconds)


def _renamed_pairs(
    alignment: Alignment, truth: TruthTable, stems: tuple[str, ...]
) -> tuple[list[TruthPair], tuple[str, ...]]:
    """Returns the pairs of which both frames are left, under their new stems, and a note on the others."""
    places = {
        traverse.name: dict(zip(traverse.take(alignment.frames[traverse.name]).stems, stems, strict=True))
        for traverse in alignment.route.traverses
    }
    pairs: list[TruthPair] = []
    lost = 0
    for pair in truth.pairs():
        query = places.get(pair.query_traverse, {}).get(pair.query)
        database = places.get(pair.database_traverse, {}).get(pair.database)
        if query is None or database is None:
            lost += 1
        else:
            pairs.append(pair._replace(query=query, database=database))
    if not pairs:
        raise RouteError(
            f"no pair of {readable(truth.path)} is left between the aligned frames; take `truth` out of route.toml if "
            "the aligned stems are to tell the places"
        )
    note = f"{lost} of {lost + len(pairs)} pairs of {truth.path.name} were left out: a frame of theirs has no partner."
    return pairs, (note,) if lost else ()


def _table(alignment: Alignment, stems: tuple[str, ...]) -> str:
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    traverses = [traverse.take(alignment.frames[traverse.name]) for traverse in alignment.route.traverses]
    lines.writerow(["stem", *(traverse.name for traverse in traverses)])
    lines.writerows(zip(stems, *(traverse.stems for traverse in traverses), strict=True))
    return text.getvalue()
