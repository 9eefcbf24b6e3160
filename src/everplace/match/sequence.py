"""Averaging similarities over sequences of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError

__all__ = ["average_sequences"]


def average_sequences(S: NDArray[Any], length: int) -> NDArray[np.floating[Any]]:
    """Averages the similarity along the diagonal, causally.

    out[i, j] = mean of S[i-k, j-k] over k = 0 .. min(length - 1, i, j): the answer at frame i uses the frames
    i-length+1 to i, fewer at the start. It is SeqSLAM's search (Milford and Wyeth, ICRA 2012) with the one
    velocity 1, which fits traverses whose frames are as far apart.

    Args:
        S: M×N scores; rows and columns in the order of travel.
        length: Number of frames L, at least 1; 1 returns a copy of S.

    Returns:
        M×N; float32 stays float32. It costs L additions of the matrix, and no memory beside the result.

    Raises:
        ConfigError: `length` is below 1.
    """
    if length < 1:
        raise ConfigError(f"--sequence {length} is not possible; give a number of frames of at least 1")
    S = np.asarray(S)
    mean = np.array(S, dtype=S.dtype if S.dtype.kind == "f" else np.float64)
    rows, columns = S.shape
    for k in range(1, min(length, rows, columns)):
        mean[k:, k:] += S[: rows - k, : columns - k]
    column_frames = np.arange(1, columns + 1).clip(max=length)
    for i in range(rows):
        mean[i] /= np.minimum(column_frames, i + 1)
    return mean
