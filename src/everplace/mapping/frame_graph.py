"""A graph of a map's frames in which the most alike are found without a look at all: HNSW, by FAISS.

Malkov and Yashunin, "Efficient and Robust Approximate Nearest Neighbor Search Using Hierarchical Navigable Small World
Graphs", IEEE TPAMI 42(4), 2020. A graph is kept as one file, which is called by the hash of the frames that it was
built from, so that it is never that of other frames.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import StorageError
from everplace.files import write_bytes
from everplace.locking import waiting_turn

__all__ = ["EFFORT", "FrameGraph"]

_ENDING = ".hnsw"
_NEIGHBOURS = 16
_EFFORT_TO_BUILD = 100
EFFORT = 768
"""Candidates that a search keeps in view (efSearch)."""
_DIGEST = 32


class FrameGraph:
    """Finds the frames most alike among N."""

    def __init__(self, index: Any) -> None:
        """Wraps an index of FAISS; use `build` and `kept`."""
        self._index = index

    @classmethod
    def build(cls, vectors: NDArray[np.float32]) -> FrameGraph:
        """Builds a graph, with some 0.6 ms a frame and core.

        Args:
            vectors: N×D of length 1.
        """
        import faiss

        index = faiss.IndexHNSWFlat(vectors.shape[1], _NEIGHBOURS)
        index.hnsw.efConstruction = _EFFORT_TO_BUILD
        index.add(vectors)
        return cls(index)

    @classmethod
    def kept(cls, vectors: NDArray[np.float32], directories: Sequence[Path]) -> FrameGraph:
        """Reads the graph of these frames, or builds it and keeps it in place of all others there.

        One process builds, and others that want the same graph wait for it. What cannot be kept anywhere is built for
        this process alone.

        Args:
            vectors: N×D of length 1.
            directories: Where to look for it, and to keep it in the first that can be written to; of this map's graphs
                alone.
        """
        name = hashlib.sha256(vectors.tobytes()).hexdigest()[:40] + _ENDING
        for directory in directories:
            if (found := _read(directory / name)) is not None:
                return found
        for directory in directories:
            with contextlib.suppress(StorageError), waiting_turn(directory / name):
                found = _read(directory / name)  # of who had the turn before
                if found is None:
                    found = cls.build(vectors)
                    data = found._to_bytes()
                    write_bytes(directory / name, hashlib.sha256(data).digest() + data)
                    _sweep(directory, name)
                return found
        return cls.build(vectors)

    def nearest(
        self,
        vector: NDArray[np.float32],
        count: int,
        left_out: NDArray[np.bool_] | None = None,
        effort: int = EFFORT,
    ) -> NDArray[np.int64]:
        """Positions of the frames most alike, best first, as many as were found.

        Args:
            vector: (D,) of length 1.
            count: How many are wanted.
            left_out: (N,) frames that do not count; the more there are, the longer it takes.
            effort: Candidates kept in view, at least `count` of them.
        """
        import faiss

        parameters = faiss.SearchParametersHNSW(efSearch=max(effort, count))
        if left_out is not None:
            shown = np.packbits(~left_out, bitorder="little")
            parameters.efSearch += int(left_out.sum())  # they are met on the way, and may be the nearest
            parameters.sel = faiss.IDSelectorBitmap(shown)
        _, found = self._index.search(vector[None], count, params=parameters)
        return np.asarray(found[0][found[0] >= 0], np.int64)

    def _to_bytes(self) -> bytes:
        import faiss

        return bytes(faiss.serialize_index(self._index).data)


def _read(path: Path) -> FrameGraph | None:
    """The graph in a file; None: there is none, or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(data[_DIGEST:]).digest() != data[:_DIGEST]:
        return None
    import faiss

    return FrameGraph(faiss.deserialize_index(np.frombuffer(data, np.uint8, offset=_DIGEST)))


def _sweep(directory: Path, name: str) -> None:
    """Removes the graphs of other frames."""
    for path in directory.glob(f"*{_ENDING}"):
        if path.name != name:
            with contextlib.suppress(OSError):  # what cannot be removed hinders nobody
                path.unlink()
