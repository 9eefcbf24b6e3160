"""The tables of a map: frames, descriptors and states, in LanceDB, in a directory or at an object store's address.

Frames and descriptors are written first; the map changes when a row of `states` names their versions, which is one
atomic commit. A reader takes the newest state and reads the tables at exactly the versions that it names, so it never
sees half of a change, whatever a writer does meanwhile or wherever it was killed.

In a directory a lock lets one writer in at a time. At an object store none can, so writers that meet are told apart
afterwards: of several states of one number the first one that was committed counts, for every reader, and who wrote
another is told that it came to nothing. Frames that two writers added at once are counted before a state names them.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.files import cache_directory, readable
from everplace.mapping.lance_failures import reading, reason, storing
from everplace.mapping.map_columns import arrow_table, as_matrix, descriptor_schema, frame_schema, state_schema
from everplace.mapping.map_state import MapState
from everplace.mapping.thumbnails import Thumbnails

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["MapTables"]

_FRAMES, _DESCRIPTORS, _STATES = "frames", "descriptors", "states"
_GRAPH = "graph"


class MapTables:
    """Reads and writes the tables at one address."""

    def __init__(self, address: str) -> None:
        """Connects.

        Args:
            address: A directory, or what LanceDB takes, such as s3://bucket/map.
        """
        self.address = address
        self._connection: Any = None

    @property
    def _database(self) -> Any:
        """The connection; made late, as it makes the directory."""
        import lancedb

        if self._connection is None:
            self._connection = lancedb.connect(self.address)
        return self._connection

    @property
    def local(self) -> Path | None:
        """The directory; None at an object store."""
        return None if "://" in self.address else Path(self.address)

    @property
    def graph_directories(self) -> tuple[Path, ...]:
        """Where the graph of the frames is kept: beside the tables, or else in the user's cache."""
        cache = cache_directory("map-graphs") / hashlib.sha256(self.address.encode()).hexdigest()[:16]
        return (cache,) if self.local is None else (self.local / _GRAPH, cache)

    @property
    def exist(self) -> bool:
        """Whether a map stands there, be it one whose creation was stopped."""
        return _STATES in self._names()

    @property
    def finished(self) -> bool:
        """Whether the map there has a version: its creation was not stopped."""
        return self.exist and self._open(_STATES).count_rows() > 0

    @property
    def others(self) -> list[str]:
        """What lies in the directory and is of no map."""
        ours = {f"{name}.lance" for name in (_FRAMES, _DESCRIPTORS, _STATES)} | {".lock", _GRAPH}
        there = () if self.local is None or not self.local.is_dir() else self.local.iterdir()
        return sorted(path.name for path in there if path.name not in ours)

    def create(self, features: int, dimensions: int) -> None:
        """Makes empty tables.

        Args:
            features: F, numbers of the map's method.
            dimensions: D, numbers of its descriptors.
        """
        self.drop()  # of a creation that was killed
        with storing(self.address):
            self._database.create_table(_FRAMES, schema=frame_schema(features))
            self._database.create_table(_DESCRIPTORS, schema=descriptor_schema(dimensions))
            self._database.create_table(_STATES, schema=state_schema())

    def drop(self) -> None:
        """Removes the tables of a map that is not whole."""
        for name in self._names():
            if name in (_FRAMES, _DESCRIPTORS, _STATES):
                self._database.drop_table(name)

    def versions(self) -> list[int]:
        """Numbers of all versions, ascending.

        Raises:
            MapError: There is no map, or it is empty.
        """
        return list(self.created())

    def created(self) -> dict[int, str]:
        """When each version was made, by its number, ascending; errors as `versions`."""
        rows = self._read(self._open(_STATES), ["version", "created"]).to_pylist()
        if not rows:
            raise MapError(f"the map {readable(self.address)} is empty: its creation was stopped; make it anew")
        first = {row["version"]: row["created"] for row in reversed(rows)}  # of equal ones the first counts
        return dict(sorted(first.items()))

    def state(self, version: int) -> MapState:
        """One of these versions.

        Raises:
            MapError: It is damaged, or of another format.
        """
        rows = self._read(self._open(_STATES), None, f"version = {version}").to_pylist()
        return MapState.from_row(rows[0], self.address)  # of equal numbers the first that was committed

    def states(self) -> list[MapState]:
        """All versions, oldest first.

        Raises:
            MapError: There is no map, it is damaged, or it is of another format.
        """
        return [self.state(version) for version in self.versions()]

    def newest(self) -> MapState:
        """The newest version.

        Raises:
            MapError: As for `states`.
        """
        return self.state(self.versions()[-1])

    def frames(self, state: MapState, columns: Sequence[str]) -> pa.Table:
        """The frames of a version, in the order of drives and frames.

        Raises:
            MapError: The table is missing or damaged.
        """
        found = self._read(self._frames_of(state), list(dict.fromkeys([*columns, "drive", "number"])))
        return found.take(self._order(state, found))

    def thumbnails(self, state: MapState) -> Thumbnails:
        """The thumbnails of a version, read one by one; errors as `frames`."""
        table = self._frames_of(state)
        return Thumbnails(self.address, table, self._order(state, self._read(table, ["drive", "number"])))

    def _frames_of(self, state: MapState) -> Any:
        table = self._open(_FRAMES)
        table.checkout(state.frames_version)
        return table

    def _order(self, state: MapState, found: pa.Table) -> NDArray[np.int64]:
        """Where the frames of a version, by drives and numbers, lie in their table."""
        order = [drive["name"] for drive in state.document["drives"]]
        rank = {name: index for index, name in enumerate(order)}
        drives = np.array([rank.get(name, -1) for name in found["drive"].to_pylist()], np.int64)
        if (drives < 0).any() or len(found) != sum(drive["frames"] for drive in state.document["drives"]):
            raise MapError(
                f"the map {readable(self.address)} is damaged: its frames are not those of its drives; restore it "
                "from a copy"
            )
        rows: NDArray[np.int64] = np.lexsort((np.asarray(found["number"]), drives))
        return rows

    def descriptors(self, state: MapState) -> NDArray[np.float32]:
        """N×D, in the order of `frames`."""
        table = self._open(_DESCRIPTORS)
        table.checkout(state.descriptors_version)
        found = self._read(table, None)
        values = as_matrix(found["descriptor"])
        return values[np.argsort(np.asarray(found["row"]), kind="stable")]

    def revert(self, state: MapState) -> None:
        """Drops what a writer that was killed wrote into the frames after the newest state."""
        table = self._open(_FRAMES)
        if table.version != state.frames_version:
            table.restore(state.frames_version)

    def add_frames(self, rows: Mapping[str, Any]) -> int:
        """Appends frames.

        Args:
            rows: A column's values by its name; `features` N×F float16.

        Returns:
            The version of the table, to be named by a state.

        Raises:
            StorageError: The disk is full or the place cannot be written to.
        """
        table = self._open(_FRAMES)
        with storing(self.address):
            return int(table.add(arrow_table(rows, table.schema)).version)

    def remove_frames(self, drive: str) -> int:
        """Deletes the frames of a drive; returns the version of the table, to be named by a state."""
        table = self._open(_FRAMES)
        quoted = drive.replace("'", "''")
        with storing(self.address):
            return int(table.delete(f"drive = '{quoted}'").version)

    def require_alone(self, frames: int, expected: int) -> None:
        """Refuses a version of the table of frames that holds what another writer added meanwhile.

        Args:
            frames: The version.
            expected: How many frames the drives have.

        Raises:
            MapError: It holds others, or fewer.
        """
        table = self._open(_FRAMES)
        table.checkout(frames)
        if table.count_rows() != expected:
            raise _lost(self.address)

    def write_descriptors(self, values: NDArray[np.float32]) -> int:
        """Replaces all descriptors; returns the version of the table, to be named by a state."""
        schema = descriptor_schema(values.shape[1])
        rows = arrow_table({"row": np.arange(len(values)), "descriptor": np.asarray(values, np.float32)}, schema)
        with storing(self.address):
            table = self._open(_DESCRIPTORS)
            if table.schema.field("descriptor").type != schema.field("descriptor").type:
                # Of another dimension: columns change their type only in a table that is made anew.
                self._database.create_table(_DESCRIPTORS, data=rows, mode="overwrite")
                return int(self._open(_DESCRIPTORS).version)
            return int(table.add(rows, mode="overwrite").version)

    def commit(self, state: MapState) -> None:
        """Makes a state the newest version of the map.

        Raises:
            StorageError: The disk is full or the place cannot be written to.
            MapError: Another process made this version meanwhile.
        """
        row = state.to_row()
        table = self._open(_STATES)
        with storing(self.address):
            table.add(arrow_table({name: [value] for name, value in row.items()}, table.schema))
        if self.local is None:
            named = ["version", "document", "frames_version", "descriptors_version"]
            first = self._read(self._open(_STATES), named, f"version = {state.version}").to_pylist()[0]
            if any(first[name] != row[name] for name in named):
                raise _lost(self.address)

    def bytes(self) -> int | None:
        """What the map takes on disk; None at another address."""
        if self.local is None:
            return None
        total = 0
        for path in self.local.rglob("*"):
            with contextlib.suppress(FileNotFoundError):  # a writer has just swept it
                total += path.stat().st_size if path.is_file() else 0
        return total

    def _names(self) -> list[str]:
        if self.local is not None and not self.local.is_dir():
            return []
        try:
            return list(self._database.list_tables(limit=100).tables)
        except Exception as error:  # LanceDB raises what its core gives
            raise MapError(
                f"cannot look for a map at {readable(self.address)} ({reason(error)}); check the address, the "
                "permissions, and for an object store what the environment says of it"
            ) from error

    def _open(self, name: str) -> Any:
        if not self.exist:
            raise MapError(f"there is no map at {readable(self.address)}; make one with `everplace map create`")
        try:
            return self._database.open_table(name)
        except Exception as error:  # LanceDB raises what its core gives
            raise MapError(
                f"the map {readable(self.address)} is damaged: its table {name} cannot be opened; restore a copy"
            ) from error

    def _read(self, table: Any, columns: list[str] | None, where: str = "") -> pa.Table:
        with reading(self.address):
            query = table.search().where(where) if where else table.search()
            return (query.select(columns) if columns else query).limit(None).to_arrow()


def _lost(address: str) -> MapError:
    return MapError(
        f"another process changed the map {readable(address)} meanwhile, so this change came to nothing; give the "
        "command again"
    )
