"""One version of a map, and the row that it is in the table of states."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.files import readable

__all__ = ["FORMAT", "MapState"]

FORMAT = 1


@dataclass(frozen=True, eq=False)
class MapState:
    """One version of a map.

    Attributes:
        version: 1, 2, ...
        created: When, UTC, ISO 8601.
        document: What is known of it: method, drives, calibration; JSON values.
        arrays: Numbers by name: the adapter, what other light changes, the conditions' model.
        frames_version: Version of the table of frames.
        descriptors_version: Version of the table of descriptors.
    """

    version: int
    created: str
    document: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]] = field(repr=False)
    frames_version: int = 0
    descriptors_version: int = 0

    @classmethod
    def new(
        cls,
        version: int,
        document: Mapping[str, Any],
        arrays: Mapping[str, NDArray[Any]],
        frames: int,
        descriptors: int,
    ) -> MapState:
        """A state of now, in the format of now; the tables by their versions."""
        created = datetime.now(timezone.utc).isoformat(timespec="seconds")
        return cls(version, created, {**document, "format": FORMAT}, arrays, frames, descriptors)

    @classmethod
    def from_row(cls, row: Mapping[str, Any], address: str) -> MapState:
        """What `to_row` gave.

        Args:
            row: Values by column.
            address: Of the map, for messages.

        Raises:
            MapError: It is damaged, or of another format.
        """
        from safetensors.numpy import load

        try:
            document = json.loads(row["document"])
            found_format = document.get("format")
            arrays = load(row["arrays"]) if found_format == FORMAT else {}
        except Exception as error:
            raise MapError(f"the map {readable(address)} is damaged ({error}); restore it from a copy") from None
        if found_format != FORMAT:
            raise MapError(
                f"the map {readable(address)} has format {found_format!r}, but this version of everplace reads "
                f"format {FORMAT}; use the version that wrote it, or make the map anew"
            )
        return cls(row["version"], row["created"], document, arrays, row["frames_version"], row["descriptors_version"])

    def to_row(self) -> dict[str, Any]:
        """Values by column."""
        from safetensors.numpy import save

        return {
            "version": self.version,
            "created": self.created,
            "document": json.dumps(self.document),
            "arrays": save({name: np.ascontiguousarray(array) for name, array in self.arrays.items()}),
            "frames_version": self.frames_version,
            "descriptors_version": self.descriptors_version,
        }
