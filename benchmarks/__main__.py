"""Runs benchmarks and prints their tables."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import (
    augmenting,
    bandwidth,
    beside_work,
    describing,
    engines,
    fabmap,
    large_map,
    memory,
    methods,
    opening,
    scores,
    search,
    sequences,
    serving,
    training,
)
from benchmarks.ratio import Ratio

STUDIES = {
    "training": training.measure,
    "augmenting": augmenting.measure,
    "describing": describing.measure,
    "engines": engines.measure,
    "bandwidth": bandwidth.measure,
    "beside-work": beside_work.measure,
    "memory": memory.measure,
    "fabmap": fabmap.measure,
    "opening": opening.measure,
    "scores": scores.measure,
    "sequences": sequences.measure,
    "search": search.measure,
    "large-map": large_map.measure,
    "serving": serving.measure,
}


def main() -> None:
    names = [*STUDIES, "methods"]
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which ones: {', '.join(names)} (default: all)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument(
        "--frames",
        type=int,
        nargs="+",
        metavar="N",
        default=search.SIZES,
        help="sizes of the maps of `search` (default: %(default)s); building a graph of 1,000,000 takes minutes",
    )
    given = parser.parse_args()
    if unknown := set(given.names) - set(names):
        parser.error(f"there is no benchmark {min(unknown)!r}; choose {', '.join(names)}")
    rows: list[Ratio] = []
    costs: list[methods.MethodCosts] = []
    for name in given.names or names:
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            if name == "methods":
                costs = methods.measure(Path(scratch))
            elif name == "search":
                rows += search.measure(Path(scratch), given.frames)
            else:
                rows += STUDIES[name](Path(scratch))
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    if given.json:
        print(json.dumps([*(row.to_dict() for row in rows), *(row.to_dict() for row in costs)], indent=2))
        return
    if costs:
        Console().print(methods.table_of(costs))
    if not rows:
        return
    table = Table("what", "measured", "against", "ratio", "wanted", "met")
    for row in rows:
        table.add_row(row.what, row.measured, row.against, f"{row.ratio:.3f}", row.wanted, "yes" if row.met else "NO")
    Console().print(table)


if __name__ == "__main__":
    main()
