"""How much each frame of a drive counts, so that a place counts once however often or long it was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["pair_weights", "place_weights"]

_ALIKE = 0.8
"""Cosine, about the drive's mean, from which two frames of one drive show the same view: a train at a station has 0.98,
neighbouring views of a walk 0.5."""
_BLOCK = 4 << 20  # cosines held at once


def place_weights(features: NDArray[np.float32]) -> NDArray[np.float64]:
    """One over the number of frames of the drive that show the same view as each: stops and loops count once.

    Args:
        features: N×F descriptors of one drive's frames.

    Returns:
        (N,) in (0, 1].
    """
    centred = features - features.mean(axis=0, dtype=np.float64).astype(np.float32)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    np.divide(centred, length, out=centred, where=length > 0)
    count = np.empty(len(centred), np.int64)
    size = max(1, _BLOCK // max(1, len(centred)))
    for start in range(0, len(centred), size):
        rows = slice(start, start + size)
        count[rows] = (centred[rows] @ centred.T >= _ALIKE).sum(axis=1)
    return 1.0 / np.maximum(count, 1)  # a frame like the mean is like none, itself included


def pair_weights(
    places: NDArray[np.int64], map_weights: NDArray[np.float64], drive_weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How much each pair counts, so that neither a stop nor a second visit makes a place heavier.

    Args:
        places: (K,) each pair's frame of the map.
        map_weights: (N,) of the map's frames, by `place_weights`.
        drive_weights: (K,) of the pairs' frames of the other drive, by `place_weights` of that drive.

    Returns:
        (K,) in (0, 1]: those of the drive's frames, scaled down where they sum to more than the map's frame weighs.
    """
    there = np.bincount(places, drive_weights, minlength=len(map_weights))
    share = np.minimum(1.0, map_weights / np.maximum(there, np.finfo(np.float64).tiny))
    return drive_weights * share[places]
