"""Scoring places by sequences of frames: averaging along the diagonal, and the choice of the search."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.choices import SEQUENCE_METHODS, SequenceMethod
from everplace.errors import ConfigError
from everplace.sequences.route_filter import filter_windows
from everplace.sequences.route_model import checked_scores
from everplace.sequences.seqslam import seqslam

__all__ = ["average_sequences", "search_sequences"]


def search_sequences(S: NDArray[Any], length: int, method: SequenceMethod = "filter") -> NDArray[np.floating[Any]]:
    """Scores every place by the last L frames, causally, with one of the searches.

    "filter" is `everplace.sequences.route_filter.filter_windows`, which follows any motion and gives log-odds;
    "seqslam" is `everplace.sequences.seqslam.seqslam`, which wants an even speed; "mean" is `average_sequences`, which
    wants frames that are as far apart as those of the database.

    Args:
        S: M×N scores; rows and columns in the order of travel.
        length: Number of frames L, at least 1; 1 returns a copy of S, whatever the method.
        method: The search.

    Returns:
        M×N, higher = more alike.

    Raises:
        ConfigError: `length` is below 1, or there is no such method.
        DescriptorsError: S is no matrix of numbers.
    """
    if method not in SEQUENCE_METHODS:
        raise ConfigError(f"the sequence method {method!r} is not known; choose {', '.join(SEQUENCE_METHODS)}")
    if method == "mean" or length <= 1:
        return average_sequences(S, length)
    return filter_windows(S, length) if method == "filter" else seqslam(S, length)


def average_sequences(S: NDArray[Any], length: int) -> NDArray[np.floating[Any]]:
    """Averages the similarity along the diagonal, causally.

    out[i, j] = mean of S[i-k, j-k] over k = 0 .. min(length - 1, i, j): the answer at frame i uses the frames
    i-length+1 to i, fewer at the start. It is SeqSLAM's search (Milford and Wyeth, ICRA 2012) with the one
    velocity 1 and no contrast enhancement, which fits traverses whose frames are as far apart.

    Args:
        S: M×N scores; rows and columns in the order of travel; NaN makes every mean that it is in NaN.
        length: Number of frames L, at least 1; 1 returns a copy of S.

    Returns:
        M×N; float32 stays float32. It costs L additions of the matrix, and no memory beside the result.

    Raises:
        ConfigError: `length` is below 1.
        DescriptorsError: S is no matrix of numbers.
    """
    S = checked_scores(S, length)
    mean = np.array(S, dtype=S.dtype if S.dtype.kind == "f" else np.float64)
    rows, columns = S.shape
    for k in range(1, min(length, rows, columns)):
        mean[k:, k:] += S[: rows - k, : columns - k]
    column_frames = np.arange(1, columns + 1).clip(max=length)
    for i in range(rows):
        mean[i] /= np.minimum(column_frames, i + 1)
    return mean
