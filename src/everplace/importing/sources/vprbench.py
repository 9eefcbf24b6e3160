"""VPR-Bench: `query/`, `ref/` and which references each query matches, in `ground_truth_new.npy`.

The format is that of Zaffar et al., "VPR-Bench: An Open-Source Visual Place Recognition Evaluation Framework
with Quantifiable Viewpoint and Appearance Change", IJCV 129, 2021: images are numbered (`0000000.jpg`), and the
file holds one row a query, its index and the list of the indices of its references.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_data_set
from everplace.importing.containers.file_trees import TreePath, by_stem, image_names, read_frames
from everplace.importing.containers.object_npy import read_object_array
from everplace.importing.foreign_route import ForeignRoute, ForeignTraverse, SourceOptions
from everplace.route.truth import TruthPair

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "VPR-Bench: query/ and ref/ with the true matches in ground_truth_new.npy"

_PARTS = ("query", "ref")
_NAMED = 5


class Options(SourceOptions):
    """Options of the kind."""

    truth: str = "ground_truth_new.npy"
    """File with the true matches, in the data set's directory."""
    same_names: bool = False
    """A query and a reference of the same file name show the same place, as in the Nordland set: keep the names, so
    that models can learn from the pairs. Otherwise names get `query-` and `ref-` before them."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a data set, the directory above it, or an archive of it; its traverses are `query` and `ref`.

    An index counts the images of a directory in natural order of their names, as the data sets number them.
    A query that the file does not mention has no true match. Published files name the references around a place, so at
    the ends of a drive some of them do not exist: these are dropped, and a note counts them.

    Raises:
        RouteError: A directory or the file is missing, the file is damaged, unsafe, or speaks of a query that does not
            exist or of a query none of whose references exists, or an archive is damaged.
    """
    root, notes = find_data_set(source, lambda place: all((place / part).is_dir() for part in _PARTS), "query and ref")
    names = {
        part: by_stem(root / part, image_names(root / part), "" if options.same_names else f"{part}-")
        for part in _PARTS
    }
    queries, references = list(names["query"]), list(names["ref"])
    truth, dropped = _read_truth(root / options.truth, len(queries), len(references))
    if dropped:
        notes.append(_note_on_dropped(dropped, len(references)))
    alone = len(queries) - sum(1 for matches in truth.values() if matches)
    if alone:
        notes.append(f"{alone} of {len(queries)} queries have no true match.")
    return ForeignRoute(
        traverses=(
            ForeignTraverse(part, read_frames(root / part, found), count=len(found)) for part, found in names.items()
        ),
        truth=(
            TruthPair("query", queries[query], "ref", references[reference])
            for query, matches in truth.items()
            for reference in matches
        ),
        notes=tuple(notes),
        truth_from=f"the data set's list of true matches, {readable(options.truth)}",
    )


def _read_truth(path: TreePath, queries: int, references: int) -> tuple[dict[int, list[int]], list[int]]:
    """Returns the indices of the references by the index of the query, and those that do not exist."""
    truth: dict[int, list[int]] = {}
    dropped: list[int] = []
    for number, row in enumerate(read_object_array(path)):
        where = f"{readable(path)}, row {number}"
        if not isinstance(row, Sequence) or len(row) < 2:
            raise RouteError(f"{where} must hold the index of a query and the list of its references; correct it")
        query = _existing(_index(row[0], f"{where}: the query"), queries, f"{where}: the query")
        if query in truth:
            raise RouteError(f"{where} speaks of the query {query} a second time; keep one row for each query")
        what = f"{where}: the reference"
        named = {_index(match, what) for match in (row[1] if isinstance(row[1], Sequence) else [row[1]])}
        missing = sorted(index for index in named if not 0 <= index < references)
        if missing and len(missing) == len(named):
            _existing(missing[0], references, what)
        dropped += missing
        truth[query] = sorted(named.difference(missing))
    if not any(truth.values()):
        raise RouteError(f"{readable(path)} holds no true match; get it again")
    return truth, dropped


def _index(value: Any, what: str) -> int:
    if isinstance(value, list) or not math.isfinite(value) or int(value) != value:
        raise RouteError(f"{what} is {str(value)[:40]} where the index of an image must be; correct it")
    return int(value)


def _existing(index: int, count: int, what: str) -> int:
    if not 0 <= index < count:
        raise RouteError(
            f"{what} {str(index)[:40]} does not exist, there are {count} images from 0 on; complete the images or "
            "correct it"
        )
    return index


def _note_on_dropped(dropped: Sequence[int], references: int) -> str:
    distinct = sorted(set(dropped))
    named = ", ".join(str(index)[:40] for index in distinct[:_NAMED])
    more = f" and {len(distinct) - _NAMED} more" if len(distinct) > _NAMED else ""
    return (
        f"{len(dropped)} references to images that do not exist were dropped: {named}{more}; there are {references} "
        "images from 0 on."
    )
