"""How well descriptors adapt to a route: plain, centred, from one drive, self-taught, and from true pairs.

    python -m studies adaptation --data DATA --out OUT

Nordland (64×32, both filters): the map is all of summer; winter places 0-999 teach, 1020 on and 1620 on are tested,
±1. Gardens Point: the map is day_right; of night_right and of day_left the places 0-69 teach, 70-139 are tested, ±3.
OUT/table.md holds recall@1 / auc_pr; rows that stand there are not made again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.registry import open_describer
from everplace.files import write_json, write_text
from everplace.mapping.route_learning import adapt
from everplace.match.matching import Matching
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, select
from everplace.scoring.retrieval import retrieve

_METHODS = ("hog", "hog16", "efficientnet", "hog16+efficientnet")
_DIMENSIONS = (96, 192, 384)
_BOTH = Selection(None, drop_dark=True, drop_stationary=True)


class Remembering(Describer):
    """A method that describes the same images once only."""

    def __init__(self, base: Describer) -> None:
        self.base, self.method, self.image = base, base.method, base.image
        self.dimension, self.batch = base.dimension, base.batch
        self._known: dict[bytes, NDArray[np.float32]] = {}

    def settings(self) -> Settings:
        return self.base.settings()

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        keys = [hashlib.sha1(image.tobytes(), usedforsecurity=False).digest() for image in images]
        new = [index for index, key in enumerate(keys) if key not in self._known]
        if new:
            for index, values in zip(new, self.base.describe_batch(images[new]), strict=True):
                self._known[keys[index]] = values
        return np.stack([self._known[key] for key in keys])


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies adaptation", description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--methods", nargs="+", default=_METHODS)
    parser.add_argument("--dimensions", nargs="+", type=int, default=_DIMENSIONS)
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    nordland = select(open_route(given.data / "nordland64"), _BOTH)
    gardens = open_route(given.data / "gardens_point")
    for method in given.methods:
        describer = Remembering(open_describer(method))
        for row in (*_nordland(describer, nordland, given), *_gardens(describer, gardens, given)):
            print(row, flush=True)
        write_text(given.out / "table.md", _table(given.out))


def _nordland(describer: Remembering, route: Route, given: argparse.Namespace) -> Iterator[str]:
    tests = (("winter", slice(1020, None), 1), ("winter", slice(1620, None), 1))
    real = given.out / f"prior-{describer.method}.safetensors"
    yield from _rows("nordland", describer, route, ["summer", "winter"], slice(None, 1000), tests, real, given)


def _gardens(describer: Remembering, route: Route, given: argparse.Namespace) -> Iterator[str]:
    for query in ("night_right", "day_left"):
        tests = ((query, slice(70, None), 3),)
        real = given.out / f"prior-{describer.method}.safetensors"
        yield from _rows(query, describer, route, ["day_right", query], slice(None, 70), tests, real, given)


def _rows(
    name: str,
    describer: Remembering,
    route: Route,
    pair: list[str],
    teach: slice,
    tests: tuple[tuple[str, slice, int], ...],
    real: Path,
    given: argparse.Namespace,
) -> Iterator[str]:
    both, alone = route.choose(pair), route.choose(pair[:1])

    def scored(tested: Describer, matching: Matching | None = None) -> list[str]:
        cells = []
        for query, frames, tolerance in tests:
            result = retrieve(
                route, query, pair[0], tested, tolerance=tolerance, query_frames=frames, matching=matching
            )
            assert result.scores is not None
            cells.append(f"{result.scores.recall_at[1]:.3f}/{result.scores.auc_pr:.3f}")
        return cells

    def row(variant: str, dimensions: int, make: object) -> str:
        path: Path = given.out / f"{name}-{describer.method}-{variant}-{dimensions}.json"
        if not path.is_file():
            begun = time.perf_counter()
            tested, told = make()  # type: ignore[operator]
            seconds = time.perf_counter() - begun
            write_json(
                path,
                {
                    "set": name, "method": describer.method, "variant": variant, "dimensions": dimensions,
                    "plain": scored(tested), "running": scored(tested, Matching("running")),
                    "pairs": told, "seconds": round(seconds, 1),
                },
            )  # fmt: skip
        return path.read_text()

    yield row("plain", describer.dimension, lambda: (describer, None))
    for dimensions in given.dimensions:

        def one(prior: str | Path, count: int = dimensions) -> tuple[Describer, object]:
            return adapt(describer, alone, prior=prior, dimensions=count).describer, None

        def taught(prior: str, *, by_itself: bool, count: int = dimensions) -> tuple[Describer, object]:
            found = adapt(describer, both, prior=prior, dimensions=count, self_taught=by_itself, teach=teach)
            drive = found.drives[0]
            return found.describer, {"share": drive.pairs.share, "right": drive.right}

        yield row("one drive, no prior", dimensions, lambda one=one: one("none"))
        yield row("one drive, shipped prior", dimensions, lambda one=one: one("default"))
        if name != "nordland" and real.is_file():
            yield row("one drive, real prior", dimensions, lambda one=one: one(real))
        yield row("self-taught, no prior", dimensions, lambda taught=taught: taught("none", by_itself=True))
        yield row("self-taught, shipped prior", dimensions, lambda taught=taught: taught("default", by_itself=True))
        yield row("true pairs, no prior", dimensions, lambda taught=taught: taught("none", by_itself=False))
    if name == "nordland" and not real.is_file():
        adapt(describer, both, prior="none", teach=teach, save_prior_to=real)


def _table(out: Path) -> str:
    lines = [
        "| set | method | variant | numbers | plain | running mean | pairs | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for path in sorted(out.glob("*.json")):
        one = json.loads(path.read_text())
        pairs = one["pairs"]
        told = (
            ""
            if pairs is None
            else f"{pairs['share']:.3f}" + ("" if pairs["right"] is None else f", {pairs['right']:.3f} right")
        )
        lines.append(
            f"| {one['set']} | {one['method']} | {one['variant']} | {one['dimensions']} | {' '.join(one['plain'])} | "
            f"{' '.join(one['running'])} | {told} | {one['seconds']} |"
        )
    return "\n".join(lines) + "\n"
