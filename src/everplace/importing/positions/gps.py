"""GPS files: positions by frame or by time, and the pose of every frame that they cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.positions.geodesy import local_plane, track_headings
from everplace.route.csv_table import CsvTable

__all__ = ["GpsTrack", "poses_on_track", "read_gps"]

_NAMES = {
    "frame": ("stem", "frame", "image"),
    "seconds": ("seconds", "time", "timestamp"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "lng"),
    "x": ("x", "easting"),
    "y": ("y", "northing"),
}
_LONGEST_GAP = 2.0


@dataclass(frozen=True, eq=False)
class GpsTrack:
    """Positions of one drive.

    Attributes:
        path: The file.
        frames: The frame of each position; empty where positions have times.
        seconds: K, when each position was measured, increasing strictly; None where positions have frames.
        positions: K×2, latitude and longitude in degrees, or x and y in metres.
        degrees: Whether they are degrees.
        lost: How many rows were at exactly (0, 0) degrees: a receiver that has no fix.
    """

    path: Path
    frames: tuple[str, ...] = field(repr=False)
    seconds: NDArray[np.float64] | None = field(repr=False)
    positions: NDArray[np.float64] = field(repr=False)
    degrees: bool
    lost: int = 0


def read_gps(path: Path) -> GpsTrack:
    """Reads a CSV file of positions.

    Args:
        path: UTF-8, with a header that names `stem` or `seconds`, and `latitude`, `longitude` (WGS 84, degrees) or
            `x`, `y` (metres), in any order and beside others; `frame`, `time`, `timestamp`, `lat`, `lon`, `easting`
            and `northing` are understood as well. Exactly 0, 0 degrees is no fix, and left out.

    Returns:
        The positions; none where no row is a fix.

    Raises:
        RouteError: The file is missing or malformed, holds a number that cannot be, goes back in time, names a
            frame twice, or is empty.
    """
    table = CsvTable(path, remedy="check the GPS file")
    columns = _columns(table)
    degrees = "latitude" in columns
    key = "frame" if "frame" in columns else "seconds"
    timed = [columns[key]] if key == "seconds" else []
    plane = [columns[name] for name in (("latitude", "longitude") if degrees else ("x", "y"))]
    frames: list[str] = []
    values: list[list[float]] = []
    for row in table:
        *seconds, first, second = row.floats([*timed, *plane], f"{key} and two numbers", "leave the row out")
        if degrees and (abs(first) > 90 or abs(second) > 360):
            raise row.wrong(f"holds {first}, {second}, no latitude and longitude; are the columns swapped?")
        if seconds and values and seconds[0] <= values[-1][0]:
            raise row.wrong("goes back in time; order the rows by time and give each time once")
        frames.append(row.cells[columns[key]].strip())
        values.append([*seconds, first, second])
    if not values:
        raise RouteError(f"{readable(path)} holds no position; export it again, or leave it out")
    if not timed and len(set(frames)) < len(frames):
        raise RouteError(f"{readable(path)} names a frame twice; keep one position for each")
    array = np.array(values)
    fixed: NDArray[np.bool_] = np.any(array[:, -2:], axis=1) | (not degrees)
    named = () if timed else tuple(frames[index] for index in np.flatnonzero(fixed))
    times = array[fixed, 0] if timed else None
    return GpsTrack(path, named, times, array[fixed, -2:], degrees, lost=int((~fixed).sum()))


def poses_on_track(
    track: GpsTrack,
    frames: Sequence[str],
    seconds: NDArray[np.float64] | None,
    origin: tuple[float, float],
) -> NDArray[np.float64]:
    """Gives the frames of a drive their poses.

    Times between two fixes are interpolated, unless the fixes are more than 2 seconds apart. The heading is the
    direction of travel.

    Args:
        track: Positions of the drive.
        frames: N names of frames, in the order of travel.
        seconds: N, when they were taken, on the clock of the track; None: not known.
        origin: Latitude and longitude of the plane's origin, of no effect for positions in metres.

    Returns:
        N×3: x, y in metres, heading in radians; NaN where the track says nothing.

    Raises:
        RouteError: The track has times, but the frames have none.
    """
    plane = local_plane(track.positions, origin) if track.degrees else track.positions
    poses = np.full((len(frames), 3), np.nan)
    if not len(plane):
        return poses
    if track.seconds is None:
        number = {frame: index for index, frame in enumerate(track.frames)}
        where = np.array([number.get(frame, -1) for frame in frames], np.int64)
        poses[where >= 0, :2] = plane[where[where >= 0]]
    elif seconds is None:
        raise RouteError(
            f"{readable(track.path)} has times, but the frames have none; give it a column `stem` with their names"
        )
    else:
        after = np.searchsorted(track.seconds, seconds)
        exact = track.seconds[np.minimum(after, len(plane) - 1)] == seconds
        inner = np.clip(after, 1, max(1, len(plane) - 1))
        near = (after > 0) & (after < len(plane))
        if len(plane) > 1:
            near &= track.seconds[inner] - track.seconds[inner - 1] <= _LONGEST_GAP
        covered = near | exact
        for column in range(2):
            poses[covered, column] = np.interp(seconds[covered], track.seconds, plane[:, column])
    known = np.isfinite(poses[:, 0])
    poses[known, 2] = track_headings(poses[known, :2])
    return poses


def _columns(table: CsvTable) -> dict[str, str]:
    """Returns what the column of each quantity is called."""
    known = {name.lower(): name for name in reversed(table.columns)}
    columns = {quantity: known[name] for quantity, names in _NAMES.items() for name in reversed(names) if name in known}
    keyed = "frame" in columns or "seconds" in columns
    on_earth = {"latitude", "longitude"} <= set(columns)
    if not keyed or not (on_earth or {"x", "y"} <= set(columns)):
        raise RouteError(
            f"{readable(table.path)} must name stem or seconds, and latitude and longitude or x and y, in its first "
            "line; add the header"
        )
    if not on_earth:
        columns.pop("latitude", None)
    return columns
