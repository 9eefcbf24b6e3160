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
    A query that the file does not mention has no true match.

    Raises:
        RouteError: A directory or the file is missing, the file is damaged, unsafe, or speaks of images that do not
            exist, or an archive is damaged.
    """
    root, notes = find_data_set(source, lambda place: all((place / part).is_dir() for part in _PARTS), "query and ref")
    names = {
        part: by_stem(root / part, image_names(root / part), "" if options.same_names else f"{part}-")
        for part in _PARTS
    }
    queries, references = list(names["query"]), list(names["ref"])
    truth = _read_truth(root / options.truth, len(queries), len(references))
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


def _read_truth(path: TreePath, queries: int, references: int) -> dict[int, list[int]]:
    """Returns the indices of the references by the index of the query."""
    truth: dict[int, list[int]] = {}
    for number, row in enumerate(read_object_array(path)):
        where = f"{readable(path)}, row {number}"
        if not isinstance(row, Sequence) or len(row) < 2:
            raise RouteError(f"{where} must hold the index of a query and the list of its references; correct it")
        query = _index(row[0], queries, f"{where}: the query")
        if query in truth:
            raise RouteError(f"{where} speaks of the query {query} a second time; keep one row for each query")
        matches = row[1] if isinstance(row[1], Sequence) else [row[1]]
        truth[query] = sorted({_index(match, references, f"{where}: the reference") for match in matches})
    if not any(truth.values()):
        raise RouteError(f"{readable(path)} holds no true match; get it again")
    return truth


def _index(value: Any, count: int, what: str) -> int:
    if isinstance(value, list) or not math.isfinite(value) or int(value) != value:
        raise RouteError(f"{what} is {str(value)[:40]} where the index of an image must be; correct it")
    if not 0 <= value < count:
        raise RouteError(
            f"{what} {str(value)[:40]} does not exist, there are {count} images from 0 on; complete the images or "
            "correct it"
        )
    return int(value)
