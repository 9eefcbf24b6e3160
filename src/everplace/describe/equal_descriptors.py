"""A warning where most descriptors of a drive are equal: all black, or all of one picture."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.files import readable

__all__ = ["MajorityVote"]

# Networks round an image's descriptor differently at different places of a batch.
_ROUNDING = 1e-5


class MajorityVote:
    """Finds the descriptor that more than half of a drive's could be equal to, while they pass (Boyer and Moore)."""

    def __init__(self) -> None:
        self._common: NDArray[np.float32] | None = None
        self._votes = 0
        self._rows = 0

    def see(self, row: NDArray[np.float32]) -> None:
        """Counts one descriptor, (D,)."""
        self._rows += 1
        if self._common is None or not self._votes:
            self._common = row.copy()
        self._votes += 1 if _equal(row, self._common) else -1

    def warn_of_equal(self, rows: Iterable[NDArray[np.float32]], source: Path) -> None:
        """Warns where more than half are equal but for rounding, such as all zero.

        Args:
            rows: All descriptors that were seen, once more.
            source: What they describe.
        """
        if self._common is None or self._votes <= 0 or self._rows == 1:
            return
        equal = sum(_equal(row, self._common) for row in rows)
        if 2 * equal > self._rows:
            what = "equal" if self._common.any() else "zero"
            warnings.warn(
                f"{equal} of the {self._rows} descriptors of {readable(source)} are {what}, so no score tells "
                "these frames apart; look at the images with everplace data inspect: are they black, or all the same?",
                stacklevel=3,
            )


def _equal(row: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    return bool(np.abs(row - other).max() <= _ROUNDING * np.abs(other).max())
