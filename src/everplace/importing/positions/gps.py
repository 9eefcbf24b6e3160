"""GPS files: positions by frame or by time, and the pose of every frame that they cover."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.positions.geodesy import local_plane, track_headings

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
    """

    path: Path
    frames: tuple[str, ...] = field(repr=False)
    seconds: NDArray[np.float64] | None = field(repr=False)
    positions: NDArray[np.float64] = field(repr=False)
    degrees: bool


def read_gps(path: Path) -> GpsTrack:
    """Reads a CSV file of positions.

    Args:
        path: UTF-8, with a header that names `stem` or `seconds`, and `latitude`, `longitude` (WGS 84, degrees) or
            `x`, `y` (metres), in any order and beside others; `frame`, `time`, `timestamp`, `lat`, `lon`, `easting`
            and `northing` are understood as well.

    Raises:
        RouteError: The file is missing or malformed, holds a number that cannot be, goes back in time, names a
            frame twice, or is empty.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            track = _read(path, csv.reader(file, strict=True))
    except OSError as error:
        raise RouteError(f"cannot read {readable(path)}: {error.strerror or error}; check the GPS file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise RouteError(f"{readable(path)} is not a UTF-8 CSV file ({error}); export it again") from error
    return track


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


def _read(path: Path, lines: Iterator[list[str]]) -> GpsTrack:
    columns = _columns(path, [name.strip().lower() for name in next(lines, [])])
    degrees = "latitude" in columns
    key = "frame" if "frame" in columns else "seconds"
    wanted = ("latitude", "longitude") if degrees else ("x", "y")
    keys: list[str] = []
    positions: list[tuple[float, float]] = []
    seconds: list[float] = []
    for row, line in enumerate(lines, start=2):
        if not line:
            continue
        where = f"{readable(path)}, row {row}"
        try:
            name = line[columns[key]].strip()
            first, second = (float(line[columns[part]]) for part in wanted)
            time = float(name) if key == "seconds" else 0.0
        except (IndexError, ValueError) as error:
            raise RouteError(f"{where} must hold {key} and two numbers; correct it") from error
        if not all(map(math.isfinite, (first, second, time))):
            raise RouteError(f"{where} holds a number that is not finite; leave the row out")
        if degrees and (abs(first) > 90 or abs(second) > 360):
            raise RouteError(f"{where}: {first}, {second} is no latitude and longitude; are the columns swapped?")
        if seconds and key == "seconds" and time <= seconds[-1]:
            raise RouteError(f"{where} goes back in time; order the rows by time and give each time once")
        keys.append(name)
        seconds.append(time)
        positions.append((first, second))
    if not positions:
        raise RouteError(f"{readable(path)} holds no position; export it again, or leave it out")
    if key == "frame" and len(set(keys)) < len(keys):
        raise RouteError(f"{readable(path)} names a frame twice; keep one position for each")
    return GpsTrack(
        path,
        tuple(keys) if key == "frame" else (),
        np.array(seconds) if key == "seconds" else None,
        np.array(positions),
        degrees,
    )


def _columns(path: Path, header: list[str]) -> dict[str, int]:
    """Returns the column of each quantity that the header names."""
    columns = {
        quantity: header.index(name) for quantity, names in _NAMES.items() for name in names[::-1] if name in header
    }
    keyed = "frame" in columns or "seconds" in columns
    if not keyed or not ({"latitude", "longitude"} <= set(columns) or {"x", "y"} <= set(columns)):
        raise RouteError(
            f"{readable(path)} must name stem or seconds, and latitude and longitude or x and y, in its first line; "
            "add the header"
        )
    if not {"latitude", "longitude"} <= set(columns):
        columns.pop("latitude", None)
    return columns
