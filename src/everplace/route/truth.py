"""Ground truth: which database frames show the place of a query frame."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError, NotAlignedError, RouteError
from everplace.files import readable, whole_file
from everplace.route.csv_table import CsvTable, TableRow
from everplace.route.natural_order import natural_sorted
from everplace.route.spelling import spelling_hint
from everplace.route.traverse import Traverse

__all__ = [
    "TRUTH_CSV",
    "TruthPair",
    "TruthTable",
    "require_shared_stems",
    "tolerance_band",
    "truth_by_pose",
    "truth_by_position",
    "write_truth",
]

TRUTH_CSV = "truth.csv"
"""What a file of pairs is called by those who write one."""


class TruthPair(NamedTuple):
    """Two frames that show the same place; also the columns of a file of pairs.

    Attributes:
        query_traverse: Name of a traverse.
        query: Stem of one of its frames.
        database_traverse: Name of a traverse; it may be the same.
        database: Stem of one of its frames.
    """

    query_traverse: str
    query: str
    database_traverse: str
    database: str


class TruthTable:
    """The ground truth of a route as a file of pairs says it, for sets where neither stem nor pose tells it.

    The file is a UTF-8 CSV file whose first line names the columns of `TruthPair`. It is read when the first
    truth is asked for. A pair holds in both directions: to look for a database frame among the queries is the
    same question. A frame that no line names has no true match.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path, traverses: Sequence[Traverse]) -> None:
        """Remembers where the pairs are; the traverses are the whole ones, which no filter has touched.

        Raises:
            RouteError: There is no such file.
        """
        if not path.is_file():
            raise RouteError(f"{readable(path)} does not exist; add the file, or correct `truth` in route.toml")
        self.path = path
        self._traverses = {traverse.name: traverse for traverse in traverses}

    def matches(self, query: Traverse, database: Traverse) -> NDArray[np.bool_]:
        """Tells which frames show the same place.

        Args:
            query: M frames of a traverse of the route.
            database: N frames of a traverse of the route.

        Returns:
            M×N bool.

        Raises:
            RouteError: The file is malformed, names a traverse or stem that does not exist, or holds no pair of
                these two traverses.
        """
        there = self._pairs.get((query.name, database.name))
        back = self._pairs.get((database.name, query.name))
        if there is None and back is None:
            known = ", ".join(f"{first!r} and {second!r}" for first, second in self._pairs)
            raise RouteError(
                f"{readable(self.path)} holds no pair of {query.name!r} and {database.name!r}, only of "
                f"{known or 'nothing'}; choose other traverses, or give a tolerance or a radius"
            )
        truth = np.zeros((len(query), len(database)), dtype=np.bool_)
        rows, columns = self._now_at(query), self._now_at(database)
        for pairs, turned in ((there, False), (back, True)):
            if pairs is None:
                continue
            first, second = pairs.T[::-1] if turned else pairs.T
            row, column = rows[first], columns[second]
            kept = (row >= 0) & (column >= 0)
            truth[row[kept], column[kept]] = True
        return truth

    def pairs(self) -> Iterator[TruthPair]:
        """Yields every pair, traverse by traverse.

        Raises:
            RouteError: The file is malformed, or names a traverse or stem that does not exist.
        """
        for (query, database), pairs in self._pairs.items():
            asking, answering = self._traverses[query].stems, self._traverses[database].stems
            for first, second in pairs.tolist():
                yield TruthPair(query, asking[first], database, answering[second])

    def _now_at(self, traverse: Traverse) -> NDArray[np.int64]:
        """Returns where each frame of the whole traverse is in the given part of it; -1: left out."""
        position = {stem: index for index, stem in enumerate(traverse.stems)}
        return np.array([position.get(stem, -1) for stem in self._traverses[traverse.name].stems], dtype=np.int64)

    @cached_property
    def _pairs(self) -> dict[tuple[str, str], NDArray[np.int64]]:
        """K×2 positions in the whole traverses, by the traverses' names."""
        table = CsvTable(self.path, TruthPair._fields, "check its permissions")
        places = {
            name: {stem: index for index, stem in enumerate(traverse.stems)}
            for name, traverse in self._traverses.items()
        }
        found: dict[tuple[str, str], array[int]] = {}
        for row in table:
            pair = TruthPair(*map(row.cells.__getitem__, TruthPair._fields))
            at = [_position(row, places, *frame) for frame in (pair[:2], pair[2:])]
            found.setdefault((pair.query_traverse, pair.database_traverse), array("q")).extend(at)
        return {names: np.frombuffer(pairs, dtype=np.int64).reshape(-1, 2) for names, pairs in found.items()}


def write_truth(path: Path, pairs: Iterable[TruthPair]) -> int:
    """Writes a file of pairs as `TruthTable` reads it, whole or not at all.

    Returns:
        How many pairs were written.

    Raises:
        StorageError: The place cannot be written to.
    """
    count = 0
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)  # a stem with a carriage return is quoted only by this kind of line end
        writer.writerow(TruthPair._fields)
        for count, pair in enumerate(pairs, start=1):  # noqa: B007
            writer.writerow(pair)
    return count


def truth_by_position(
    query: Traverse, database: Traverse, tolerance: int, places: Iterable[str] = ()
) -> NDArray[np.bool_]:
    """Tells the same places by stem, give or take some places.

    The distance of two frames counts places along the natural order of all stems that either traverse has,
    not the digits in the stems: where a filter removed places, the ones around the gap are neighbours.

    Args:
        query: M frames.
        database: N frames.
        tolerance: Places by which a match may be off; 0: the same stem only.
        places: Stems that count as places along the way too, though neither traverse has a frame of them here.

    Returns:
        M×N bool.

    Raises:
        ConfigError: The tolerance is negative.
        NotAlignedError: The traverses share no stem.
    """
    if tolerance < 0:
        raise ConfigError(f"tolerance {tolerance} is negative; give 0 or a number of frames")
    require_shared_stems(query, database)
    place = {stem: rank for rank, stem in enumerate(natural_sorted({*query.stems, *database.stems, *places}))}
    rows, columns = ([place[stem] for stem in traverse.stems] for traverse in (query, database))
    return tolerance_band(rows, columns, tolerance)


def require_shared_stems(query: Traverse, database: Traverse) -> None:
    """Makes sure that two traverses have a stem in common.

    Raises:
        NotAlignedError: They have none.
    """
    if frozenset(query.stems).isdisjoint(database.stems):
        raise NotAlignedError(
            f"the traverses {query.name!r} and {database.name!r} share no stem, so nobody knows which frames "
            "show the same place; name frames of the same place alike, find them with `everplace data align`, or add "
            f"poses and give a radius{spelling_hint(query.stems, database.stems)}"
        )


def tolerance_band(query: Sequence[int], database: Sequence[int], tolerance: int) -> NDArray[np.bool_]:
    """Tells which places are at most so many apart.

    Args:
        query: The positions of M frames along the way.
        database: The positions of N frames, in any order.
        tolerance: Places, 0 or more.

    Returns:
        M×N bool.
    """
    # Further than all places is all of them; NumPy's integers end before Python's do.
    tolerance = min(tolerance, max([*query, *database], default=0) - min([*query, *database], default=0))
    rows, columns = np.array(query, dtype=np.int64), np.array(database, dtype=np.int64)
    order = np.argsort(columns)
    first = np.searchsorted(columns[order], rows - tolerance, side="left")
    end = np.searchsorted(columns[order], rows + tolerance, side="right")
    band = np.zeros((len(rows), len(columns)), dtype=np.bool_)
    for row in range(len(rows)):
        band[row, order[first[row] : end[row]]] = True
    return band


def truth_by_pose(query: Traverse, database: Traverse, radius: float) -> NDArray[np.bool_]:
    """Tells the same places by distance; headings are not compared.

    Args:
        query: M frames with poses.
        database: N frames with poses.
        radius: Metres up to which two frames show the same place, included.

    Returns:
        M×N bool.

    Raises:
        ConfigError: The radius is not a positive number.
        RouteError: One of the traverses has no poses.
    """
    from scipy.spatial import KDTree

    if not (np.isfinite(radius) and radius > 0):
        raise ConfigError(f"`radius` {radius} is not a positive number of metres; give one")
    neighbours = KDTree(_positions(database)).query_ball_point(_positions(query), radius)
    truth = np.zeros((len(query), len(database)), dtype=np.bool_)
    for row, columns in enumerate(neighbours):
        truth[row, columns] = True
    return truth


def _position(row: TableRow, places: Mapping[str, Mapping[str, int]], traverse: str, stem: str) -> int:
    """Returns where a frame that a row names is in its traverse."""
    if traverse not in places:
        raise row.wrong(
            f"names the traverse {traverse!r}, which the route does not have; there are: "
            f"{', '.join(map(readable, places))}{spelling_hint([traverse], places)}"
        )
    if stem not in places[traverse]:
        raise row.wrong(
            f"names the frame {stem!r}, which the traverse {traverse!r} does not have; correct the line or "
            f"add the frame{spelling_hint([stem], places[traverse])}"
        )
    return places[traverse][stem]


def _positions(traverse: Traverse) -> NDArray[np.float64]:
    """Returns N×2 metres."""
    if traverse.poses is None:
        raise RouteError(
            f"the traverse {traverse.name!r} has no poses; put a poses.csv with the columns stem,x,y,heading "
            "into its directory or name one in route.toml, or give a tolerance in frames"
        )
    return traverse.poses[:, :2]
