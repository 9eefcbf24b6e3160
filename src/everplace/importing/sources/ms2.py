"""KAIST MS2: drives with colour, near-infrared and thermal stereo cameras (Shin, Park and Kweon, CVPR 2023).

    sync_data/<sequence>/<camera>/img_left/000000.png
    sync_data/<sequence>/<camera>/img_left_timestamp.txt    a time a line
    sync_data/<sequence>/gps_imu/data/000000.txt            latitude, longitude, altitude, ..., a number a line

The sequence's name is when it was driven, such as `_2021-08-06-10-59-33`.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.frame_names import choose_frames
from everplace.images.sixteen_bits import SixteenBits, used_range
from everplace.importing.containers.data_set_search import find_data_set
from everplace.importing.containers.file_trees import TreePath, by_stem, read_files
from everplace.importing.foreign_route import (
    Content,
    Encoded,
    ForeignFrame,
    ForeignRoute,
    ForeignTraverse,
    ScaledOptions,
)
from everplace.importing.frame_pixels import values_of_16_bits
from everplace.importing.positions.geodesy import local_plane, track_headings
from everplace.importing.sources._kaist_conditions import condition_of, read_conditions
from everplace.route.natural_order import natural_sorted
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "KAIST MS2: drives by day, night and rain with colour, near-infrared and thermal cameras, and GPS"

_DRIVEN = re.compile(r"_?([0-9]{4}-[0-9]{2}-[0-9]{2})-([0-9]{2})-[0-9]{2}-[0-9]{2}")
_RAINY_DATE, _RAINY_FROM, _NIGHT_FROM = "2021-08-06", 16, 20
_LONGEST_LINE = 1000
_SAMPLE = 64
_TIME_UNITS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
_LICENCE = "MS2 is for research only; cite Shin, Park and Kweon (CVPR 2023)."


class Options(ScaledOptions):
    """Options of the kind."""

    sequences: tuple[str, ...] = ()
    """Which to take, such as _2021-08-06-10-59-33; by default all."""
    camera: Literal["rgb", "nir", "thr"] = "rgb"
    """rgb, nir or thr; the 16-bit values of thr are scaled by what each drive uses, unless range or bits is given."""
    side: Literal["left", "right"] = "left"
    """left or right."""
    conditions: tuple[str, ...] = ()
    """Conditions such as _2021-08-06-10-59-33:day, or a CSV or TOML file of them; by default day, night (from 20
    o'clock on) or rain (the afternoon of 2021-08-06)."""
    every: Annotated[int, Field(ge=1)] = 1
    """Take every so many-th frame."""


@dataclass(frozen=True, eq=False)
class _Drive:
    """One sequence; `positions` are degrees, `seconds` None where the times are not there, `lost` frames left out."""

    name: str
    directory: TreePath
    files: tuple[str, ...] = field(repr=False)
    positions: NDArray[np.float64] | None = field(repr=False)
    seconds: NDArray[np.float64] | None = field(repr=False)
    lost: int
    scale: SixteenBits


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a copy of the data set, unpacked or as archives; the positions of all frames are read at once.

    Raises:
        RouteError: It is not MS2, or a sequence or archive is incomplete or damaged.
        ConfigError: A sequence that is wanted is not there, or a condition cannot be.
    """
    images = f"{options.camera}/img_{options.side}"
    root, notes = find_data_set(
        # `proj_depth` beside `sync_data` holds directories of the same names.
        source,
        lambda place: bool(_sequences(place, images)),
        "sequences of MS2",
        preferred="sync_data",
    )
    known = _sequences(root, options.camera)
    if not known:
        raise RouteError(
            f"{readable(source)} holds no sync_data/<sequence>/{images}; give the directory above sync_data"
        )
    for name in options.sequences:
        if name not in known:
            raise ConfigError(f"sequences={name!r} is not there; there are: {', '.join(map(readable, known))}")
    table = read_conditions(options.conditions)
    drives = [_open(root / name, options) for name in known if not options.sequences or name in options.sequences]
    fixes = [drive.positions[0] for drive in drives if drive.positions is not None]
    origin = (float(fixes[0][0]), float(fixes[0][1])) if fixes else (0.0, 0.0)
    notes.append(_LICENCE)
    bare = [readable(drive.name) for drive in drives if drive.positions is None and not drive.lost]
    notes += [f"{name} has no gps_imu/data: it gets no poses." for name in bare]
    notes += [_note_on_fixes(drive) for drive in drives if drive.lost]
    notes += [
        f"The 16-bit values {drive.scale.low}:{drive.scale.high} of {readable(drive.name)} became 0 to 255, which is "
        "what its frames use; `range` or `bits` gives all drives one scale."
        for drive in drives
        if options.range is None and options.bits is None and not drive.scale.is_whole
    ]
    return ForeignRoute(
        _traverses(drives, origin, table),
        notes=notes,
        truth_from="positions by GPS" if fixes else "",
    )


def _traverses(
    drives: Sequence[_Drive], origin: tuple[float, float], table: dict[str, str]
) -> Iterator[ForeignTraverse]:
    for drive in drives:
        name = drive.name.lstrip("_.")
        condition = condition_of(table, drive.name) or condition_of(table, name) or _condition(drive.name)
        yield ForeignTraverse(name, _frames(drive, name, origin), condition=condition, count=len(drive.files))


def _frames(drive: _Drive, name: str, origin: tuple[float, float]) -> Iterator[ForeignFrame]:
    poses: NDArray[np.float64] | None = None
    if drive.positions is not None:
        plane = local_plane(drive.positions, origin)
        poses = np.column_stack([plane, track_headings(plane)])
    for (index, file), content in read_files(drive.directory, {file: (i, file) for i, file in enumerate(drive.files)}):
        # Frames of one number in two drives show different places: they get different stems.
        yield ForeignFrame(
            f"{name}_{file.rpartition('.')[0]}",
            content,
            None if poses is None else Pose(*poses[index].tolist()),
            None if drive.seconds is None else float(drive.seconds[index]),
            drive.scale,
        )


def _condition(name: str) -> str:
    """Tells the condition by the time at which a sequence was driven; empty if the name does not say it."""
    match = _DRIVEN.fullmatch(name)
    if match is None:
        return ""
    date, hour = match[1], int(match[2])
    if hour >= _NIGHT_FROM:
        return "night"
    return "rain" if date == _RAINY_DATE and hour >= _RAINY_FROM else "day"


def _sequences(directory: TreePath, camera: str) -> list[str]:
    return [name for name in directory.children().directories if (directory / name / camera).is_dir()]


def _open(root: TreePath, options: Options) -> _Drive:
    directory = root / options.camera / f"img_{options.side}"
    names = by_stem(directory, choose_frames(directory, directory.children().files))
    if not names:
        raise RouteError(f"{readable(directory)} holds no image; unpack it, or leave the sequence out with sequences=")
    stems = natural_sorted(names)
    times = _read_times(directory.parent / f"{directory.name}_timestamp.txt", len(stems))
    gps = root / "gps_imu" / "data"
    chosen = stems[:: options.every]
    positions = _read_positions(gps, chosen, f"an image of {readable(directory)}") if gps.is_dir() else None
    files = np.array([names[stem] for stem in chosen], dtype=object)
    times = None if times is None else times[:: options.every]
    fixed = np.ones(len(files), np.bool_) if positions is None else positions.any(axis=1)
    lost = int((~fixed).sum())
    if lost == len(files):
        scale = _scale(directory, tuple(files), options)
        return _Drive(root.name, directory, tuple(files), None, times, lost, scale)
    kept = tuple(files[fixed])
    return _Drive(
        root.name,
        directory,
        kept,
        None if positions is None else positions[fixed],
        None if times is None else times[fixed],
        lost,
        _scale(directory, kept, options),
    )


def _note_on_fixes(drive: _Drive) -> str:
    """Says what became of frames at exactly 0, 0 degrees, where the receiver had no fix."""
    name = readable(drive.name)
    if drive.positions is None:
        return f"{name} holds no fix in gps_imu/data, 0, 0 throughout: it gets no poses."
    return (
        f"{drive.lost} of {drive.lost + len(drive.files)} frames of {name} are at exactly 0, 0, where the receiver had "
        "no fix, and were left out."
    )


def _scale(directory: TreePath, files: Sequence[str], options: Options) -> SixteenBits:
    """Returns the scale of a drive: as given, or for a thermal camera the range that a sample of its frames uses."""
    if options.camera != "thr" or options.range is not None or options.bits is not None:
        return options.scale()
    step = -(-len(files) // _SAMPLE)
    sample = read_files(directory, {file: file for file in files[::step]})
    values = (values_of_16_bits(ForeignFrame(file, content)) for file, content in sample)
    try:
        low, high = used_range(frame for frame in values if frame is not None)
    except ValueError:  # a copy of 8 bits
        return options.scale()
    return SixteenBits(low, high + 1)


def _read_positions(directory: TreePath, stems: Sequence[str], where: str) -> NDArray[np.float64]:
    """Returns N×2 degrees."""
    names = [f"{stem}.txt" for stem in stems]
    read = read_files(directory, {name: name for name in names}, where)
    found = {name: _read_position(directory / name, content) for name, content in read}
    return np.array([found[name] for name in names])


def _read_position(path: TreePath, content: Content) -> tuple[float, float]:
    """Reads latitude and longitude; the order differs between copies, and beyond 90 degrees is a longitude."""
    try:
        with io.BytesIO(content.data) if isinstance(content, Encoded) else path.open() as file:
            first, second = (float(file.readline(_LONGEST_LINE)) for _ in range(2))
    except ValueError as error:
        raise RouteError(f"{readable(path)} must begin with two lines of one number each; copy it again") from error
    latitude, longitude = (second, first) if abs(first) > 90 else (first, second)
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise RouteError(
            f"{readable(path)} begins with {first}, {second}, which is no position on Earth; copy it again"
        )
    return latitude, longitude


def _read_times(path: TreePath, count: int) -> NDArray[np.float64] | None:
    """Reads one time a line, in seconds, milli-, micro- or nanoseconds since 1970; None if there is no file."""
    if not path.is_file():
        return None
    try:
        with path.open() as file:
            times = np.array([float(word) for word in file.read().decode("ascii").split()])
    except ValueError as error:
        raise RouteError(f"{readable(path)} must hold one number a line; copy it again") from error
    if len(times) != count or not np.isfinite(times).all():
        raise RouteError(
            f"{readable(path)} holds {len(times)} times, but must hold {count}, one for each image, all finite; "
            "copy it again"
        )
    largest = float(np.abs(times).max())
    divisor = next((unit for least, unit in _TIME_UNITS if largest >= least), 1.0)
    return times / divisor
