"""How much each frame of a drive counts, so that a place counts once however often or long it was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["pair_weights", "place_weights"]

_ALIKE = 0.8
"""Cosine, about the drive's mean, from which two frames of one drive show the same view: a train at a station has 0.98,
neighbouring views of a walk 0.5."""
_BLOCK = 4 << 20  # cosines held at once
_ROUNDS = 3
_SETTLED = 0.01
"""Share of the frames' variance by which their mean may still be off."""


def place_weights(features: NDArray[np.float32]) -> NDArray[np.float64]:
    """One over the number of frames of the drive that show the same view as each: stops and loops count once.

    The mean that cosines are taken about is that of the places, not of the frames: about the mean of a drive that stood
    for most of its time, the frames of the stop would be nothing but noise, and all others alike.

    Args:
        features: N×F descriptors of one drive's frames, in the order of travel.

    Returns:
        (N,) in (0, 1].
    """
    mean = _mean(features, _travelled(features))
    for _ in range(_ROUNDS):
        weights, variance = _about(features, mean)
        before, mean = mean, _mean(features, weights)
        if np.square(mean - before).sum() <= _SETTLED * variance:
            break
    return weights


def _mean(features: NDArray[np.float32], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    total = weights.sum()
    mean = weights @ features / total if total else features.mean(axis=0, dtype=np.float64)
    return np.asarray(mean, np.float32)


def _travelled(features: NDArray[np.float32]) -> NDArray[np.float64]:
    """(N,): how much the view changes to each frame and from it, in squares: a stop's noise is little."""
    steps = np.square(np.diff(features, axis=0)).sum(axis=1, dtype=np.float64)
    both: NDArray[np.float64] = np.append(steps, 0.0) + np.append(0.0, steps)
    return both


def _about(features: NDArray[np.float32], mean: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
    """The weights by cosines about a mean, and the variance about it."""
    centred = features - mean
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    np.divide(centred, length, out=centred, where=length > 0)
    count = np.empty(len(centred), np.int64)
    size = max(1, _BLOCK // max(1, len(centred)))
    for start in range(0, len(centred), size):
        rows = slice(start, start + size)
        count[rows] = (centred[rows] @ centred.T >= _ALIKE).sum(axis=1)
    # A frame like the mean is like none, itself included.
    return 1.0 / np.maximum(count, 1), float(np.square(length).mean())


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
