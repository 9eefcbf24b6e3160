"""Poses of frames, from a CSV file with the columns stem, x, y, heading."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable

__all__ = ["read_poses"]

_COLUMNS = ("stem", "x", "y", "heading")


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
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            found = _read_rows(path, csv.reader(file, strict=True), frozenset(stems))
    except OSError as error:
        raise RouteError(
            f"cannot read {readable(path)}: {error.strerror or error}; check `poses` in route.toml"
        ) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 CSV file ({error}); export it again") from error
    missing = [stem for stem in stems if stem not in found]
    if missing:
        raise RouteError(
            f"{readable(path)} has no pose for {len(missing)} of {len(stems)} frames, the first is "
            f"{missing[0]!r}; add a line for each frame, or move the frames without a pose out of the route"
        )
    poses = np.array([found[stem] for stem in stems], dtype=np.float64).reshape(-1, 3)
    poses.flags.writeable = False
    return poses


def _read_rows(path: Path, lines: Iterator[list[str]], wanted: frozenset[str]) -> dict[str, tuple[float, float, float]]:
    """Returns x, y, heading by stem."""
    header = [name.strip() for name in next(lines, [])]
    absent = [name for name in _COLUMNS if name not in header]
    if absent:
        raise RouteError(
            f"{readable(path)} lacks the column {absent[0]!r} in its first line; it must name stem, x, y, heading"
        )
    columns = [header.index(name) for name in _COLUMNS]
    found: dict[str, tuple[float, float, float]] = {}
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        where = f"{readable(path)}, row {number}"
        try:
            stem, x, y, heading = (line[column] for column in columns)
            pose = (float(x), float(y), float(heading))
        except (IndexError, ValueError) as error:
            raise RouteError(f"{where} must hold a stem and three numbers; correct it") from error
        if not np.isfinite(pose).all():
            raise RouteError(f"{where} holds a number that is not finite; correct it or leave the frame out")
        if stem in found:
            raise RouteError(f"{where} names the stem {stem!r} a second time; keep one pose for each frame")
        if stem in wanted:
            found[stem] = pose
    return found
