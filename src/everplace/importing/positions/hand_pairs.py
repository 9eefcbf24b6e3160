"""Pairs of frames that somebody set by hand, from a CSV file.

For two drives the columns may be called `stem_a` and `stem_b`; else they are called like the drives, one column
each, and a cell may be empty:

    summer,winter,night
    00012,00009,00031
    00410,00388,
    00777,00741,00702
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable

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
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [(number, line) for number, line in enumerate(csv.reader(file, strict=True), start=1) if line]
    except OSError as error:
        raise RouteError(f"cannot read {readable(path)}: {error.strerror or error}; check --pairs") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 CSV file ({error}); export it again") from error
    columns = _columns(path, [name.strip() for name in lines[0][1]] if lines else [], reference, drives)
    numbers = {name: {stem: number for number, stem in enumerate(drives[name])} for name in columns}
    found: dict[str, list[tuple[int, int]]] = {name: [] for name in columns if name != reference}
    for row, line in lines[1:]:
        cells = {name: line[column].strip() if column < len(line) else "" for name, column in columns.items()}
        for name, stem in cells.items():
            if stem and stem not in numbers[name]:
                raise RouteError(f"{readable(path)}, row {row}: {name!r} has no frame {stem!r}; correct the stem")
        for name, pairs in found.items():
            if cells[reference] and cells[name]:
                pair = (numbers[reference][cells[reference]], numbers[name][cells[name]])
                if pairs and (pair[0] <= pairs[-1][0] or pair[1] <= pairs[-1][1]):
                    raise RouteError(
                        f"{readable(path)}, row {row}: the pair {cells[reference]!r}, {cells[name]!r} goes back or "
                        "stays; order the pairs along the route and give each frame once"
                    )
                pairs.append(pair)
    for name, pairs in found.items():
        if len(pairs) < 2:
            raise RouteError(
                f"{readable(path)} holds {len(pairs)} pairs of {reference!r} and {name!r}; give at least two, at the "
                "beginning and the end of what they share"
            )
    return {name: np.array(pairs, np.int64) for name, pairs in found.items()}


def _columns(path: Path, header: list[str], reference: str, drives: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Returns the column of each drive."""
    others = [name for name in drives if name != reference]
    if header[:2] == _TWO and len(others) == 1:
        header = [reference, others[0]]
    missing = [name for name in drives if name not in header]
    if missing:
        example = readable(",".join([reference, *others]))
        raise RouteError(
            f"{readable(path)} has no column for {missing[0]!r} in its first line; it must name the drives, like "
            f"{example}"
        )
    return {name: header.index(name) for name in drives}
