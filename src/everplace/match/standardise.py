"""Standardising the descriptors of a traverse, so that what all its frames share no longer speaks.

Schubert, Neubert and Protzel, "Unsupervised Learning Methods for Visual Place Recognition in Discretely and
Continuously Changing Environments", ICRA 2020.
"""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from everplace.choices import Standardisation
from everplace.describe.files.descriptors import Descriptors, Metric
from everplace.errors import ConfigError
from everplace.files import shortened

__all__ = ["require_standardisable", "standardisable", "standardise"]

_STARTS = 10  # frames that the map's mean counts as, at the start of a drive; chosen on training places
_ROWS = 1024  # descriptors handled at once in double precision


def standardise(
    descriptors: Descriptors, how: Standardisation, *, start: NDArray[np.float64] | None = None
) -> Descriptors:
    """Subtracts the traverse's mean descriptor; "full" also divides each dimension by its standard deviation.

    The statistics are those of the given descriptors alone: query and database are each standardised by their
    own traverse, seen as a whole. A single frame becomes zero, and so does a dimension that does not vary.

    Args:
        descriptors: N×D descriptors of one traverse.
        how: "centre", "full", or "running", which is "centre" for a map, and for a drive that is still going on
            subtracts from each frame the mean of the frames so far, its own included.
        start: (D,) of "running", the map's mean descriptor, with which the drive's mean starts as if 10 frames before
            the first had it; None: the descriptors are the map's.

    Returns:
        New descriptors whose settings say how they were standardised.

    Raises:
        ConfigError: `how` is something else, or the descriptors are words.
    """
    if how not in get_args(Standardisation):
        raise ConfigError(f"the standardisation {how!r} is not known; choose centre, full or running")
    require_standardisable(descriptors.method, descriptors.metric)
    if start is not None and how == "running":
        return _replaced(descriptors, _running(descriptors.values, start), how)
    # In double precision the mean of N equal float32 is exact, so a dimension that does not vary is seen.
    mean = descriptors.values.mean(axis=0, dtype=np.float64)
    blocks = [slice(start, start + _ROWS) for start in range(0, len(descriptors), _ROWS)]
    scale = np.ones_like(mean)
    if how == "full":
        squares = sum(np.square(descriptors.values[rows] - mean).sum(axis=0) for rows in blocks)
        deviation = np.sqrt(squares / len(descriptors))
        np.divide(1.0, deviation, out=scale, where=deviation > 0)
    values = np.empty_like(descriptors.values)
    for rows in blocks:
        values[rows] = (descriptors.values[rows] - mean) * scale
    return _replaced(descriptors, values, how)


def _replaced(descriptors: Descriptors, values: NDArray[np.float32], how: Standardisation) -> Descriptors:
    return replace(descriptors, values=values, settings={**descriptors.settings, "standardise": how})


def _running(values: NDArray[np.float32], start: NDArray[np.float64]) -> NDArray[np.float32]:
    """Subtracts from each row the mean of the rows so far and of ten that are `start`."""
    out = np.empty_like(values)
    total, seen = _STARTS * start, _STARTS
    for first in range(0, len(values), _ROWS):
        block = values[first : first + _ROWS].astype(np.float64)
        sums = total + np.cumsum(block, axis=0)
        out[first : first + _ROWS] = block - sums / (seen + np.arange(1, len(block) + 1))[:, None]
        total, seen = sums[-1], seen + len(block)
    return out


def standardisable(metric: Metric) -> bool:
    """Whether descriptors still mean something when their mean is subtracted: words are there or not."""
    return metric != "place-posterior"


def require_standardisable(method: str, metric: Metric) -> None:
    """Makes sure that descriptors can be standardised.

    Raises:
        ConfigError: They are words.
    """
    if not standardisable(metric):
        raise ConfigError(f"`standardise` does not apply to the words of {shortened(method)}; leave it out")
