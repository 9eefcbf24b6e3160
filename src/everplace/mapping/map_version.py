"""One version of a map, as it is read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.discriminant import Projection
from everplace.describe.describer import Describer
from everplace.describe.reduced import reduced, unreduced
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber
from everplace.errors import MapError
from everplace.files import readable
from everplace.mapping.calibration import Calibration
from everplace.mapping.condition_model import ConditionModel
from everplace.mapping.held_out_answers import HeldOutAnswers
from everplace.mapping.map_columns import as_matrix
from everplace.mapping.map_state import MapState
from everplace.mapping.map_tables import MapTables
from everplace.mapping.thumbnails import Thumbnails

__all__ = ["MapVersion"]


class MapVersion:
    """A version of a map: its drives, frames and descriptors, and what it learnt.

    Attributes:
        address: Where it lies.
    """

    def __init__(self, tables: MapTables, state: MapState) -> None:
        """Wraps a state of the map."""
        self.address = tables.address
        self._tables, self._state = tables, state
        self._describer: Describer | None = None

    @property
    def version(self) -> int:
        """1 for a new map; every change adds one."""
        return self._state.version

    @property
    def created(self) -> str:
        """When this version was made, UTC, ISO 8601."""
        return self._state.created

    @property
    def document(self) -> Mapping[str, Any]:
        """Method, drives, calibration and what was learnt."""
        return self._state.document

    @property
    def method(self) -> str:
        """What describes its frames."""
        return str(self.document["method"])

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of its drives, oldest first."""
        return tuple(drive["name"] for drive in self.document["drives"])

    @property
    def conditions(self) -> tuple[str, ...]:
        """The conditions that it knows."""
        return tuple(dict.fromkeys(drive["condition"] for drive in self.document["drives"]))

    @property
    def origin(self) -> tuple[float, ...]:
        """Latitude and longitude from which the metres of its poses count; empty: they are of no place on Earth."""
        return tuple(self.document.get("origin", ()))

    @property
    def calibration(self) -> Calibration:
        """How scores become probabilities."""
        return Calibration.from_dict(self.document["calibration"])

    @property
    def projection(self) -> Projection:
        """From the method's numbers to the map's descriptor."""
        arrays = self._state.arrays
        return Projection(arrays["weight"].astype(np.float64), arrays["bias"].astype(np.float64))

    @property
    def held_out_answers(self) -> HeldOutAnswers:
        """What it answered to its own frames while they were held out."""
        return HeldOutAnswers.from_arrays(self._state.arrays)

    @property
    def condition_model(self) -> ConditionModel:
        """Tells conditions apart."""
        prefix = "condition."
        arrays = {
            key.removeprefix(prefix): array for key, array in self._state.arrays.items() if key.startswith(prefix)
        }
        return ConditionModel.from_arrays({**arrays, "conditions": np.array(self.document["known_conditions"])})

    @property
    def graph_directories(self) -> tuple[Path, ...]:
        """Where the graph of its frames is kept (`everplace.mapping.frame_graph`), the first that can be written to."""
        return self._tables.graph_directories

    def describer(self) -> Describer:
        """The map's method, opened once.

        Raises:
            MapError: It gives other numbers here than those in the map.
        """
        if self._describer is None:
            describer = reduced(open_describer(self.method))
            if dict(describer.settings()) != dict(self.document["settings"]):
                raise MapError(
                    f"the map {readable(self.address)} was made with {self.method} of other settings than it has here "
                    "(other weights, or another version); install what it was made with, or make the map anew"
                )
            self._describer = describer
        return self._describer

    def adapted(self) -> AdaptedDescriber:
        """What gives the map's descriptors of images: its method with its projection."""
        base, projection = unreduced(self.describer(), self.projection)
        return AdaptedDescriber(base, projection, {"method": self.method, "map_version": self.version})

    def frames(self, *columns: str) -> Any:
        """Columns of the map's frames as an Arrow table, in the order of drives and frames."""
        return self._tables.frames(self._state, columns)

    def thumbnails(self) -> Thumbnails:
        """Small pictures of the frames, in the order of `frames`, read one by one."""
        return self._tables.thumbnails(self._state)

    def descriptors(self) -> NDArray[np.float32]:
        """N×D, in the order of `frames`."""
        return self._tables.descriptors(self._state)

    def info(self) -> dict[str, Any]:
        """What `everplace map info` prints: drives, places, conditions, method, calibration, size, version."""
        table = self.frames("place")
        places = np.asarray(table["place"])
        condition = {one["name"]: one["condition"] for one in self.document["drives"]}
        of_frames = [condition[name] for name in table["drive"].to_pylist()]
        seen = Counter(
            one
            for one, _ in {(name, place) for name, place in zip(of_frames, places.tolist(), strict=True) if place >= 0}
        )
        return {
            "drives": [
                {key: one[key] for key in ("name", "condition", "frames", "sure", "how", "learns")}
                for one in self.document["drives"]
            ],
            "places": len(np.unique(places[places >= 0])),
            "conditions": {name: seen[name] for name in self.conditions},
            "method": self.method,
            "dimension": len(self._state.arrays["bias"]),
            "calibration": self.document["calibration"],
            "learnt_from": self.document["learnt"],
            "bytes": self._tables.bytes(),
            "version": self.version,
        }

    @property
    def takes_fixes(self) -> bool:
        """Whether metres from a place on Earth go together with the poses it has."""
        return bool(self.origin) or bool(np.isnan(np.asarray(self.frames("x")["x"])).all())

    def fault(self) -> str | None:
        """Reads all of it; a sentence says what is not as it should be."""
        try:
            table = self.frames("place", "position", "features")
            values = self.descriptors()
        except MapError as error:
            return f"version {self.version}: {error}"
        features = as_matrix(table["features"])
        if len(values) != len(table):
            return f"version {self.version} has {len(table)} frames but {len(values)} descriptors"
        if not (np.isfinite(features).all() and np.isfinite(values).all()):
            return f"version {self.version} holds numbers that are not finite"
        found = self.projection.apply(features)
        if not np.allclose(found, values, atol=1e-3 * max(1.0, float(np.abs(values).max()))):
            return f"the descriptors of version {self.version} are not those of its features"
        return None
