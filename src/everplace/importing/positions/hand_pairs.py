"""Pairs of frames that somebody set by hand, from a CSV file.

For two drives the columns may be called `stem_a` and `stem_b`; else they are called like the drives, one column
each, and a cell may be empty:

    summer,winter,night
    00012,00009,00031
    00410,00388,
    00777,00741,00702
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.route.csv_table import CsvTable
from everplace.route.spelling import spelling_hint

__all__ = ["read_pairs"]

_TWO = ["stem_a", "stem_b"]


def read_pairs(path: Path, reference: str, drives: Mapping[str, Sequence[str]]) -> dict[str, NDArray[np.int64]]:
    """Reads which frames of the reference show the same place as which frames of the other drives.

    Args:
        path: A UTF-8 CSV file whose first line names `stem_a` (the reference) and `stem_b` (the other of two
            drives), or drives, among them the reference.
        reference: The drive that the others are aligned with.
        drives: The stems of each drive, in the order of travel.

    Returns:
        For each other drive K×2 indices of frames, the reference's first, both columns increasing strictly; K is
        at least 2.

    Raises:
        RouteError: The file is missing or malformed, names a drive or frame that does not exist, goes back, or
            has fewer than two pairs for a drive.
    """
    table = CsvTable(path, remedy="check `pairs`")
    columns = _columns(table, reference, drives)
    numbers = {name: {stem: number for number, stem in enumerate(drives[name])} for name in columns}
    found: dict[str, list[tuple[int, int]]] = {name: [] for name in columns if name != reference}
    for row in table:
        cells = {name: row.cells[column].strip() for name, column in columns.items()}
        for name, stem in cells.items():
            if stem and stem not in numbers[name]:
                hint = spelling_hint([stem], numbers[name])
                raise row.wrong(f"names the frame {stem!r}, which {name!r} does not have; correct the stem{hint}")
        for name, pairs in found.items():
            if cells[reference] and cells[name]:
                pair = (numbers[reference][cells[reference]], numbers[name][cells[name]])
                if pairs and (pair[0] <= pairs[-1][0] or pair[1] <= pairs[-1][1]):
                    raise row.wrong(
                        f"holds the pair {cells[reference]!r}, {cells[name]!r}, which goes back or stays; order the "
                        "pairs along the route and give each frame once"
                    )
                pairs.append(pair)
    for name, pairs in found.items():
        if len(pairs) < 2:
            raise RouteError(
                f"{readable(path)} holds {len(pairs)} pairs of {reference!r} and {name!r}; give at least two, at the "
                "beginning and the end of what they share"
            )
    return {name: np.array(pairs, np.int64) for name, pairs in found.items()}


def _columns(table: CsvTable, reference: str, drives: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Returns the column of each drive."""
    others = [name for name in drives if name != reference]
    if table.columns[:2] == _TWO and len(others) == 1:
        return {reference: _TWO[0], others[0]: _TWO[1]}
    missing = [name for name in drives if name not in table.columns]
    if missing:
        example = readable(",".join([reference, *others]))
        raise RouteError(
            f"{readable(table.path)} has no column for {missing[0]!r} in its first line; it must name the drives, like "
            f"{example}{spelling_hint(missing, table.columns)}"
        )
    return {name: name for name in drives}
