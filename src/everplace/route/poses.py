"""Poses of frames, from a CSV file with the columns stem, x, y, heading."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.route.csv_table import read_frames

__all__ = ["read_poses"]

_NUMBERS = ("x", "y", "heading")


def read_poses(path: Path, stems: Sequence[str]) -> NDArray[np.float64]:
    """Reads the poses of some frames.

    Args:
        path: A UTF-8 CSV file whose first line names at least the columns stem, x, y (metres) and heading
            (radians), in any order. Rows of other stems are ignored.
        stems: The frames.

    Returns:
        N×3 float64, read-only, in the order of `stems`.

    Raises:
        RouteError: The file is missing or malformed, holds a number that is not finite or a stem twice, or
            lacks a frame.
    """
    return read_frames(path, stems, _NUMBERS, "pose", "check `poses` in route.toml")
