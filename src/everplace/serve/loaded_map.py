"""One version of a map, read whole: what answers rest on."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from everplace.mapping.localizer import Localizer
from everplace.mapping.route_map import Map
from everplace.mapping.thumbnails import Thumbnails
from everplace.serve.map_summary import map_summary
from everplace.serve.query_translation import QueryTranslation
from everplace.serve.refusal import RefusedError

__all__ = ["LoadedMap"]


class LoadedMap:
    """One version of the map with all that answers rest on; nothing of it changes.

    Attributes:
        version: Its number.
        tag: Tells it from other versions and other maps.
        localizer: Whose copies answer.
        thumbnails: Of its frames.
        translation: Shows queries in other conditions.
        summary: The JSON of `GET /map`.
    """

    def __init__(self, map_: Map) -> None:
        """Reads the map; errors as `Localizer`."""
        self.version = map_.version
        self.tag = f"{map_.version}-{map_.created}"
        self.localizer = Localizer(map_)
        self.thumbnails: Thumbnails = map_.thumbnails()
        self.translation = QueryTranslation(map_, self.thumbnails)
        summary = map_summary(map_, self.localizer.places, decodes=self.translation.possible)
        self.summary = json.dumps(summary, allow_nan=False).encode()
        self._frames = map_.frames("stem", "place", "x", "y", "heading")
        self._condition = {drive["name"]: drive["condition"] for drive in map_.document["drives"]}

    def frame(self, row: int) -> dict[str, Any]:
        """What is known of a frame.

        Raises:
            RefusedError: There is none of this number.
        """
        self._require(row)
        known = {name: column[0] for name, column in self._frames.slice(row, 1).to_pydict().items()}
        pose = [known["x"], known["y"], known["heading"]]
        return {
            "id": row,
            "drive": known["drive"],
            "condition": self._condition[known["drive"]],
            "frame": known["stem"],
            "place": known["place"] if known["place"] >= 0 else None,
            "pose": None if np.isnan(pose).any() else pose,
        }

    def thumbnail(self, row: int) -> bytes:
        """The JPEG file of a frame.

        Raises:
            RefusedError: There is none of this number.
            MapError: The map was removed or damaged meanwhile.
        """
        self._require(row)
        return self.thumbnails.read(row)

    def _require(self, row: int) -> None:
        if not 0 <= row < len(self.thumbnails):
            raise RefusedError(404, f"the map has no frame of this number; it has 0 to {len(self.thumbnails) - 1}")
