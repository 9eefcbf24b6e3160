"""Poses of frames, from a CSV file with the columns stem, x, y, heading."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.data.csv_table import read_table
from everplace.errors import RouteError
from everplace.files import readable

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
    wanted = frozenset(stems)
    found: dict[str, tuple[float, ...]] = {}
    for row in read_table(path, "stem", _NUMBERS, "check `poses` in route.toml"):
        if row.key in found:
            raise row.wrong(f"names the stem {row.key!r} a second time; keep one pose for each frame")
        if row.key in wanted:
            found[row.key] = row.numbers
    missing = [stem for stem in stems if stem not in found]
    if missing:
        raise RouteError(
            f"{readable(path)} has no pose for {len(missing)} of {len(stems)} frames, the first is "
            f"{missing[0]!r}; add a line for each frame, or move the frames without a pose out of the route"
        )
    poses = np.array([found[stem] for stem in stems], dtype=np.float64).reshape(-1, 3)
    poses.flags.writeable = False
    return poses
