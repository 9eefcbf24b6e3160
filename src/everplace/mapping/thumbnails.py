"""Small pictures of a map's frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.mapping.lance_failures import reading

__all__ = ["Thumbnails"]


class Thumbnails:
    """The thumbnails of the frames of a version; several threads may read at once."""

    def __init__(self, address: str, table: Any, rows: NDArray[np.int64]) -> None:
        """Keeps the table, at its version, and where the frames lie in it."""
        self._address, self._table, self._rows = address, table, rows

    def __len__(self) -> int:
        """Returns the number of frames."""
        return len(self._rows)

    def read(self, frame: int) -> bytes:
        """The JPEG file of a frame, by its row in the order of `MapTables.frames`.

        Raises:
            MapError: The map was removed or damaged meanwhile.
        """
        with reading(self._address):
            found = self._table.take_offsets([int(self._rows[frame])]).select(["thumbnail"]).to_arrow()
        data: bytes = found["thumbnail"][0].as_py()
        return data
