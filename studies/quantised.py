"""What descriptors in fewer bytes cost: half floats, whole numbers, product-quantised and binary, on Nordland.

    python -m studies quantised --data DATA --out OUT

`hog16` adapted to the route, self-taught, no prior; Nordland (64×32, both filters), ±1. What was chosen was chosen on
places 0-999 alone: summer is the map, winter 0-499 teaches, 520-999 is tested. The report: all of summer is the map,
winter 0-999 teaches, and winter from 1020 on is tested. Whatever a form has to learn, such as the centroids of
product quantisation, it learns from the map's frames. OUT/table.md holds recall@1 / auc_pr of single frames.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from everplace.describe.registry import open_describer
from everplace.files import write_text
from everplace.mapping.route_learning import adapt
from everplace.match.similarity import directions, similarity
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, select
from everplace.scoring.retrieval import Retrieval, retrieve
from everplace.scoring.scores import evaluate
from studies.adaptation import Remembering

__all__ = ["Form", "forms"]

Coding: TypeAlias = Callable[[NDArray[np.float32]], NDArray[np.float32]]

_DIMENSIONS = (96, 192)
_PQ_BYTES = (8, 12, 16, 24, 32, 48)
_FILTERS = Selection(drop_dark=True, drop_stationary=True)


@dataclass(frozen=True)
class Form:
    """How a descriptor is kept.

    Attributes:
        name: What the table calls it.
        bytes: Of one descriptor.
        coded: N×D to what is left of it once it was kept so; of length 1 beforehand.
        queries_too: Whether queries are kept in this form too, else they have all their numbers.
    """

    name: str
    bytes: float
    coded: Coding
    queries_too: bool = False


def forms(known: NDArray[np.float32]) -> Iterator[Form]:
    """All forms, fitted to a map.

    Args:
        known: N×D of length 1, the map's frames.
    """
    import faiss

    dimensions = known.shape[1]
    yield Form("float32", 4 * dimensions, lambda values: values)
    yield Form("float16", 2 * dimensions, lambda values: values.astype(np.float16).astype(np.float32))
    for bits, kind in ((8, faiss.ScalarQuantizer.QT_8bit), (4, faiss.ScalarQuantizer.QT_4bit)):
        yield Form(f"int{bits}", dimensions * bits / 8, _coding(faiss.ScalarQuantizer(dimensions, kind), known))
    for size in _PQ_BYTES:
        quantiser = faiss.ProductQuantizer(dimensions, size, 8)
        quantiser.cp.min_points_per_centroid = 1  # else it warns of so few frames
        yield Form("product-quantised", size, _coding(quantiser, known))
    mean = known.mean(axis=0)
    yield Form("binary, signs", dimensions / 8, lambda values: _signs(values - mean), queries_too=True)
    rotation = faiss.ITQTransform(dimensions, dimensions, False)
    rotation.train(known)
    yield Form("binary, ITQ", dimensions / 8, lambda values: _signs(rotation.apply(values)), queries_too=True)


def _coding(quantiser: object, known: NDArray[np.float32]) -> Coding:
    """Encoding and decoding by a quantiser of FAISS, which learns from the map."""
    quantiser.train(known)  # type: ignore[attr-defined]
    return lambda values: quantiser.decode(quantiser.compute_codes(values))  # type: ignore[attr-defined]


def _signs(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """1 or -1: the cosine of two such vectors counts the bits that differ."""
    return np.where(values >= 0, np.float32(1), np.float32(-1))


def _rows(found: Retrieval) -> Iterator[tuple[Form, str]]:
    assert found.truth is not None
    query, database = (found.describer.describe(traverse) for traverse in (found.pair.query, found.pair.database))
    asked, known = directions(query.values), directions(database.values)
    for form in forms(known):
        kept = replace(query, values=form.coded(asked) if form.queries_too else asked)
        scores = evaluate(similarity(kept, replace(database, values=form.coded(known))), found.truth)
        yield form, f"{scores.recall_at[1]:.3f}/{scores.auc_pr:.3f}"


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies quantised", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="directory that holds nordland64")
    parser.add_argument("--out", type=Path, required=True, help="directory for table.md")
    given = parser.parse_args(arguments)
    whole = open_route(given.data / "nordland64").choose(["summer", "winter"])
    describer = Remembering(open_describer("hog16"))
    tests: tuple[tuple[Route, int, slice], ...] = (
        (select(whole, replace(_FILTERS, frames=slice(0, 1000))), 500, slice(520, None)),
        (select(whole, _FILTERS), 1000, slice(1020, None)),
    )
    lines = list(_HEAD)
    for dimensions in _DIMENSIONS:
        cells: dict[tuple[str, float], list[str]] = {}
        for route, taught, tested in tests:
            adapted = adapt(
                describer, route, prior="none", dimensions=dimensions, self_taught=True, teach_frames=slice(taught)
            ).describer
            found = retrieve(route, "winter", "summer", adapted, tolerance=1, query_frames=tested)
            for form, scores in _rows(found):
                cells.setdefault((form.name, form.bytes), []).append(scores)
        for (name, size), scores_of in cells.items():
            lines.append(f"| {dimensions} | {name} | {size:g} | " + " | ".join(scores_of) + " |")
            print(lines[-1], flush=True)
    write_text(given.out / "table.md", "\n".join([*lines, ""]))


_HEAD = ("| numbers | kept as | bytes | places 520-999 | **1,020 on** |", "|---|---|---|---|---|")
