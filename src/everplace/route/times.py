"""Times of frames, from a CSV file with the columns stem, seconds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.route.csv_table import read_frames

__all__ = ["read_times"]


def read_times(path: Path, stems: Sequence[str]) -> NDArray[np.float64]:
    """Reads when some frames were taken.

    Args:
        path: A UTF-8 CSV file whose first line names at least the columns stem and seconds (from any fixed moment), in
            any order. Rows of other stems are ignored.
        stems: The frames.

    Returns:
        N float64 seconds, read-only, in the order of `stems`.

    Raises:
        RouteError: The file is missing or malformed, holds a number that is not finite or a stem twice, or lacks a
            frame.
    """
    return read_frames(path, stems, ("seconds",), "time", "check the file")[:, 0]
