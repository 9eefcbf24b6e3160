"""CSV tables: the one reader of all that the program reads, and the poses and times of frames in them."""

from __future__ import annotations

import contextlib
import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.regular_files import open_regular_text
from everplace.route.spelling import spelling_hint

__all__ = ["CsvTable", "TableRow", "read_poses", "read_times"]


_LARGEST = 1e30  # its square, and a sum of such, is still a number


class TableRow(NamedTuple):
    """One row.

    Attributes:
        path: The file.
        number: The row, counted from 1 with the header.
        cells: What stands in it, by column.
    """

    path: Path
    number: int
    cells: Mapping[str, str]

    def wrong(self, what: str) -> RouteError:
        """Returns an error that names the file and the row."""
        return RouteError(f"{readable(self.path)}, row {self.number} {what}")

    def floats(
        self, columns: Sequence[str], what: str, remedy: str = "correct it or leave the frame out"
    ) -> list[float]:
        """Reads finite numbers.

        Args:
            columns: Where they stand.
            what: What a row must hold, for the message.
            remedy: What to do with a number that is not finite.

        Raises:
            RouteError: One is no number, or not finite.
        """
        try:
            values = [float(self.cells[column]) for column in columns]
        except ValueError as error:
            raise self.wrong(f"must hold {what}; correct it") from error
        if not all(map(math.isfinite, values)):
            raise self.wrong(f"holds a number that is not finite; {remedy}")
        if any(abs(value) > _LARGEST for value in values):
            raise self.wrong(f"holds a number beyond ±{_LARGEST:g}, which nothing can be computed with; {remedy}")
        return values


class CsvTable:
    """A UTF-8 CSV file whose first line names its columns, in any order.

    Attributes:
        path: The file.
        columns: What the first line names.
    """

    def __init__(self, path: Path, wanted: Sequence[str] = (), remedy: str = "check the file") -> None:
        """Reads the first line.

        Args:
            path: The file.
            wanted: Columns that must be there, beside others.
            remedy: What to do if the file is missing.

        Raises:
            RouteError: The file is missing or malformed, or lacks a column.
        """
        self.path = path
        self._remedy = remedy
        refuse_pointer(path, RouteError)
        with self._lines() as lines:
            self.columns = [name.strip() for name in next(lines, [])]
        while self.columns and not self.columns[-1]:
            self.columns.pop()
        absent = [name for name in wanted if name not in self.columns]
        if absent:
            raise RouteError(
                f"{readable(path)} lacks the column {absent[0]!r} in its first line; it must name {', '.join(wanted)}"
            )

    def __iter__(self) -> Iterator[TableRow]:
        """Yields the rows that are not empty.

        Raises:
            RouteError: The file is malformed, or a row has more or fewer cells than the first line; empty ones at its
                end count as none.
        """
        count = len(self.columns)
        places = {name: self.columns.index(name) for name in self.columns}
        with self._lines() as lines:
            next(lines, None)
            for number, line in enumerate(lines, start=2):
                if line and (len(line) < count or any(line[count:])):
                    raise RouteError(
                        f"{readable(self.path)}, row {number} has {len(line)} cells, but the first line names {count} "
                        "columns; correct it (a decimal comma makes two cells of one number: write a point)"
                    )
                if line:
                    yield TableRow(self.path, number, {name: line[at] for name, at in places.items()})

    @contextlib.contextmanager
    def _lines(self) -> Iterator[Iterator[list[str]]]:
        try:
            with open_regular_text(self.path) as file:
                yield csv.reader(file, strict=True)
        except OSError as error:
            raise RouteError(f"cannot read {readable(self.path)}: {error.strerror or error}; {self._remedy}") from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise RouteError(f"{readable(self.path)} is not a UTF-8 CSV file ({error}); export it again") from error


def read_poses(path: Path, stems: Sequence[str]) -> NDArray[np.float64]:
    """Reads the poses of some frames.

    Args:
        path: A table with the columns stem, x, y (metres) and heading (radians). Rows of other stems are ignored.
        stems: The frames.

    Returns:
        N×3 float64, read-only, in the order of `stems`.

    Raises:
        RouteError: The table is missing or malformed, holds a number that is not finite or a stem twice, or lacks a
            frame.
    """
    table = CsvTable(path, ("stem", "x", "y", "heading"), "check `poses` in route.toml")
    return _of_frames(table, ("x", "y", "heading"), stems, "pose", "three numbers")


def read_times(path: Path, stems: Sequence[str]) -> NDArray[np.float64]:
    """Reads when some frames were taken.

    Args:
        path: A table with the columns stem and seconds (from any fixed moment). Rows of other stems are ignored.
        stems: The frames.

    Returns:
        N float64 seconds, read-only, in the order of `stems`.

    Raises:
        RouteError: As for `read_poses`.
    """
    return _of_frames(CsvTable(path, ("stem", "seconds")), ("seconds",), stems, "time", "a number")[:, 0]


def _of_frames(
    table: CsvTable, columns: Sequence[str], stems: Sequence[str], what: str, numbers: str
) -> NDArray[np.float64]:
    """Returns N×K numbers in the order of the stems."""
    wanted = frozenset(stems)
    found: dict[str, list[float]] = {}
    others: set[str] = set()
    for row in table:
        stem = row.cells["stem"]
        values = row.floats(columns, f"a stem and {numbers}")
        if stem in found:
            raise row.wrong(f"names the stem {stem!r} a second time; keep one {what} for each frame")
        if stem in wanted:
            found[stem] = values
        else:
            others.add(stem)
    missing = [stem for stem in stems if stem not in found]
    if missing:
        raise RouteError(
            f"{readable(table.path)} has no {what} for {len(missing)} of {len(stems)} frames, the first is "
            f"{missing[0]!r}; add a line for each frame, or move the frames without a {what} out of the route"
            f"{spelling_hint(missing, others)}"
        )
    array = np.array([found[stem] for stem in stems], dtype=np.float64).reshape(-1, len(columns))
    array.flags.writeable = False
    return array
