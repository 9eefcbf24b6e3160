"""Tables of one comparison made several times: `python -m studies comparisons DIR DIR ... --out DIR`.

Each DIR is the --out of `everplace compare` with the same methods on the same pairs, the models trained with another
seed. What does not change with the seed stands without a spread.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path
from typing import Any

from everplace.files import write_text
from studies.tables import SCORES, spread

# Of a method whatever the pair: the key, and how many digits mean something.
COSTS = {
    "dimension": ("dimension", 0),
    "bytes": ("bytes_per_descriptor", 0),
    "ms/image": ("ms_per_image", 1),
    "peak MB": ("peak_memory_mb", 0),
}

Pair = tuple[str, str]
Comparison = dict[Pair, dict[str, dict[str, Any]]]


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies comparisons", description=__doc__)
    parser.add_argument("comparisons", type=Path, nargs="+", help="directories that everplace compare has written")
    parser.add_argument("--out", type=Path, required=True, help="directory for table.md")
    given = parser.parse_args(arguments)
    measured = [_read(directory) for directory in given.comparisons]
    methods = list(next(iter(measured[0].values())))
    for directory, one in zip(given.comparisons, measured, strict=True):
        if one.keys() != measured[0].keys() or any(list(of) != methods for of in one.values()):
            sys.exit(f"{directory} compares other methods or pairs than {given.comparisons[0]}; make it again alike")
    table = _means(measured, methods) + "\n" + _pairs(measured, methods)
    write_text(given.out / "table.md", table)
    print(table, end="")


def _read(directory: Path) -> Comparison:
    try:
        metrics = json.loads((directory / "metrics.json").read_text("utf-8"))
        return {(pair["query"], pair["database"]): pair["methods"] for pair in metrics["pairs"]}
    except (OSError, ValueError, LookupError, TypeError):
        sys.exit(f"{directory} holds no comparison of `everplace compare`; name its --out")


def _means(measured: list[Comparison], methods: list[str]) -> str:
    lines = [f"**Mean over all {len(measured[0])} ordered pairs**", ""]
    lines += [_row(["method", *SCORES, *COSTS]), "|---" * (len(SCORES) + len(COSTS) + 1) + "|"]
    for method in methods:
        values = [
            [statistics.mean(score(of[method]) for of in comparison.values()) for comparison in measured]
            for score in SCORES.values()
        ]
        of_first_pairs = [next(iter(comparison.values()))[method] for comparison in measured]
        costs = [spread([of[key] for of in of_first_pairs], digits) for key, digits in COSTS.values()]
        lines.append(_row([method, *map(spread, values), *costs]))
    return "\n".join(lines) + "\n"


def _pairs(measured: list[Comparison], methods: list[str]) -> str:
    """The area under the curve of each pair: the mean, the best of each row in bold."""
    lines = ["**auc_pr of each pair**", "", _row(["query, database", *methods]), "|---" * (len(methods) + 1) + "|"]
    for pair in measured[0]:
        values = [[float(comparison[pair][method]["auc_pr"]) for comparison in measured] for method in methods]
        best = max(map(statistics.mean, values))
        cells = [f"**{spread(of)}**" if statistics.mean(of) == best else spread(of) for of in values]
        lines.append(_row([", ".join(pair), *cells]))
    return "\n".join(lines) + "\n"


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"
