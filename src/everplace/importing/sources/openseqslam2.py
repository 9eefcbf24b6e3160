"""OpenSeqSLAM2: two directories of numbered images and a CSV file of which show the same place.

The format is that of Talbot et al., "OpenSeqSLAM2.0: An Open Source Toolbox for Visual Place Recognition Under
Changing Conditions", IROS 2018: a line `query, reference, tolerance` says that the query's true matches are the
reference images from reference - tolerance to reference + tolerance. Images are counted from 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_data_set
from everplace.importing.containers.file_trees import TreePath, by_stem, image_names, read_frames
from everplace.importing.containers.text_rows import read_rows
from everplace.importing.foreign_route import ForeignRoute, ForeignTraverse, ScaledOptions
from everplace.route.truth import TruthPair

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "OpenSeqSLAM2: two directories or lists of images and the CSV file of their ground truth"

_LISTS = (".txt", ".csv", ".lst")


class Options(ScaledOptions):
    """Options of the kind; all paths start at the source's directory."""

    query: str = "query"
    """Directory of the query images, or a text file with one image a line."""
    reference: str = "reference"
    """Directory of the reference images, or a text file with one image a line."""
    truth: str = "ground_truth.csv"
    """CSV file with the columns query, reference, tolerance and no header."""
    subsample: Annotated[int, Field(ge=1)] = 1
    """Every so manieth image was used, as the toolbox's subsample factor; the file counts those."""
    same_names: bool = False
    """A query and a reference of the same file name show the same place: keep the names. Otherwise they get `query-`
    and `reference-` before them."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a data set, the directory above it, or an archive of it; its traverses are `query` and `reference`.

    Images of a directory are counted in natural order of their names. Those of a range of true matches that lie
    before the first or behind the last reference are left out, as in the toolbox.

    Raises:
        RouteError: A file or directory is missing, or the ground truth is malformed or speaks of an image that
            does not exist.
    """
    root, notes = find_data_set(source, lambda place: (place / options.truth).is_file(), options.truth)
    frames: dict[str, dict[str, str]] = {}
    traverses: list[ForeignTraverse] = []
    for side, where in (("query", options.query), ("reference", options.reference)):
        directory, names = _list(root, where)
        frames[side] = by_stem(directory, names[:: options.subsample], "" if options.same_names else f"{side}-")
        read = read_frames(directory, frames[side], readable(root / where))
        traverses.append(ForeignTraverse(side, read, count=len(frames[side])))
    queries, references = list(frames["query"]), list(frames["reference"])
    truth = _read_truth(root / options.truth, len(queries), len(references))
    alone = len(queries) - len(truth)
    if alone:
        notes.append(f"{alone} of {len(queries)} queries have no true match.")
    return ForeignRoute(
        traverses=iter(traverses),
        truth=(
            TruthPair("query", queries[query], "reference", references[reference])
            for query, ranges in truth.items()
            for reference in sorted(set().union(*ranges))
        ),
        notes=tuple(notes),
        truth_from=f"the data set's list of true matches, {readable(options.truth)}",
    )


def _list(root: TreePath, where: str) -> tuple[TreePath, list[str]]:
    """Returns a directory and the images in it that take part, in order."""
    path = root / where
    if not where.lower().endswith(_LISTS):
        return path, image_names(path)
    names = [row.inside(0) for row in read_rows(path, "\n")]
    if not names:
        raise RouteError(f"{readable(path)} names no image; write one path a line")
    return root, names


def _read_truth(path: TreePath, queries: int, references: int) -> dict[int, list[range]]:
    """Returns the positions of the references, from 0, by the position of the query."""
    truth: dict[int, list[range]] = {}
    for row in read_rows(path, ","):
        if len(row) != 3:
            raise row.wrong(f"holds {len(row)} numbers where query, reference, tolerance must be; correct it")
        query, reference = row.whole(0, "the number of a query"), row.whole(1, "the number of a reference")
        tolerance = row.whole(2, "a tolerance")
        for what, number, count in (("query", query, queries), ("reference", reference, references)):
            if not 1 <= number <= count:
                raise row.wrong(
                    f"names the {what} {number}, but there are {count}, counted from 1; complete the images or "
                    "correct it"
                )
        if tolerance < 0:
            raise row.wrong(f"holds the tolerance {tolerance}; correct it to 0 or more")
        nearest = range(max(reference - 1 - tolerance, 0), min(reference + tolerance, references))
        truth.setdefault(query - 1, []).append(nearest)
    if not truth:
        raise RouteError(f"{readable(path)} holds no true match; write lines of query, reference, tolerance")
    return truth
