"""CSV files that give numbers by name: poses, times."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import open_regular_text, readable

__all__ = ["TableRow", "read_columns", "read_frames", "read_table"]


_LARGEST = 1e30  # its square, and a sum of such, is still a number


class TableRow(NamedTuple):
    """One row.

    Attributes:
        path: The file.
        number: The row, counted from 1 with the header.
        key: What the key's column says.
        numbers: The finite numbers of the other columns.
    """

    path: Path
    number: int
    key: str
    numbers: tuple[float, ...]

    def wrong(self, what: str) -> RouteError:
        """Returns an error that names the file and the row."""
        return RouteError(f"{readable(self.path)}, row {self.number} {what}")


def read_table(path: Path, key: str, numbers: Sequence[str], remedy: str) -> Iterator[TableRow]:
    """Reads a UTF-8 CSV file whose first line names its columns, in any order; others are passed over.

    Args:
        path: The file.
        key: The column that names the row.
        numbers: The columns of numbers.
        remedy: What to do if the file is missing.

    Raises:
        RouteError: The file is missing or malformed, lacks a column, or holds a number that is not finite.
    """
    try:
        with open_regular_text(path) as file:
            lines = csv.reader(file, strict=True)
            columns = _find_columns(path, lines, (key, *numbers))
            for number, line in enumerate(lines, start=2):
                if line:
                    yield _read_row(path, number, line, columns, (key, *numbers))
    except OSError as error:
        raise RouteError(f"cannot read {readable(path)}: {error.strerror or error}; {remedy}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 CSV file ({error}); export it again") from error


def read_frames(
    path: Path, stems: Sequence[str], numbers: Sequence[str], what: str, remedy: str
) -> NDArray[np.float64]:
    """Reads the numbers of some frames from a table whose column `stem` names the frames.

    Args:
        path: See `read_table`. Rows of other stems are ignored.
        stems: The N frames.
        numbers: The K columns of numbers.
        what: What a row gives, for messages: "pose".
        remedy: What to do if the file is missing.

    Returns:
        N×K float64, read-only, in the order of `stems`.

    Raises:
        RouteError: As for `read_table`, or the table names a stem twice, or lacks a frame.
    """
    wanted = frozenset(stems)
    found: dict[str, tuple[float, ...]] = {}
    for row in read_table(path, "stem", numbers, remedy):
        if row.key in found:
            raise row.wrong(f"names the stem {row.key!r} a second time; keep one {what} for each frame")
        if row.key in wanted:
            found[row.key] = row.numbers
    missing = [stem for stem in stems if stem not in found]
    if missing:
        raise RouteError(
            f"{readable(path)} has no {what} for {len(missing)} of {len(stems)} frames, the first is "
            f"{missing[0]!r}; add a line for each frame, or move the frames without a {what} out of the route"
        )
    values = np.array([found[stem] for stem in stems], dtype=np.float64).reshape(-1, len(numbers))
    values.flags.writeable = False
    return values


def read_columns(path: Path) -> list[str]:
    """Reads which columns the first line of a CSV file names.

    Raises:
        RouteError: The file is missing or no UTF-8 CSV file.
    """
    try:
        with open_regular_text(path) as file:
            return [name.strip() for name in next(csv.reader(file, strict=True), [])]
    except OSError as error:
        raise RouteError(f"cannot read {readable(path)}: {error.strerror or error}; check the file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 CSV file ({error}); export it again") from error


def _find_columns(path: Path, lines: Iterator[list[str]], wanted: Sequence[str]) -> list[int]:
    header = [name.strip() for name in next(lines, [])]
    absent = [name for name in wanted if name not in header]
    if absent:
        raise RouteError(
            f"{readable(path)} lacks the column {absent[0]!r} in its first line; it must name {', '.join(wanted)}"
        )
    return [header.index(name) for name in wanted]


def _read_row(path: Path, number: int, line: list[str], columns: list[int], names: Sequence[str]) -> TableRow:
    try:
        key, *texts = (line[column] for column in columns)
        row = TableRow(path, number, key, tuple(map(float, texts)))
    except (IndexError, ValueError) as error:
        raise RouteError(
            f"{readable(path)}, row {number} must hold a {names[0]} and {_count(len(names) - 1)}; correct it"
        ) from error
    if not all(map(math.isfinite, row.numbers)):
        raise row.wrong("holds a number that is not finite; correct it or leave the frame out")
    if any(abs(number) > _LARGEST for number in row.numbers):
        raise row.wrong(f"holds a number beyond ±{_LARGEST:g}, which nothing can be computed with; correct it")
    return row


def _count(numbers: int) -> str:
    return {1: "a number", 3: "three numbers"}.get(numbers, f"{numbers} numbers")
