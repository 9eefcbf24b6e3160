"""KAIST all-day: drives through the same streets by day and night, as videos or as extracted images.

| form | what lies there |
|---|---|
| `videos` | `videos/setNN/Visible_VNNN.seq` |
| `images` | `images/setNN/VNNN/Innnnn.*`, or its sub-directory `visible/`, or `images/setNN/Visible_VNNN/` |

A sequence is called `setNN/VNNN`. The images may have four channels, the last one thermal: the visible three are
taken. Positions come from `gps/setNN/VNNN.csv` (see `everplace.importing.positions.gps`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.importing.foreign_route import ForeignFrame, ForeignRoute, ForeignTraverse, SourceOptions
from everplace.importing.positions.gps import GpsTrack, poses_on_track, read_gps
from everplace.importing.positions.hand_pairs import read_pairs
from everplace.importing.positions.shared_places import align_all_by_pairs, align_all_by_position, sparsest
from everplace.importing.sources._kaist_conditions import condition_of, read_conditions
from everplace.importing.sources._kaist_sequences import KaistSequence, find_sequences
from everplace.route.traverse import Pose

__all__ = ["SUMMARY", "Options", "read"]

SUMMARY = "KAIST all-day: videos (.seq) or images of the same streets by day, night, sunset and sunrise"

_PAPER_CONDITIONS = frozenset({"day", "night", "sunset", "sunrise"})
_PAPER_SEQUENCES, _PAPER_TRAINING, _PAPER_TEST = 6, 1600, 6400
_PAPER_PROTOCOL = "KAIST, 1,600 training and 6,400 test places"
_LICENCE = (
    "KAIST's multispectral data sets are for research only; cite Choi et al. (IEEE T-ITS 2018) or Hwang et al. (CVPR "
    "2015)."
)


class Options(SourceOptions):
    """Options of the kind."""

    form: Literal["", "videos", "images"] = ""
    """videos or images; by default images where they lie there."""
    sequences: tuple[str, ...] = ()
    """Which to take, such as set00/V000,set03; by default all."""
    conditions: tuple[str, ...] = ()
    """Conditions such as set00:day,set03/V001:night, or a CSV or TOML file of them."""
    every: Annotated[int, Field(ge=1)] = 1
    """Take every so many-th frame, or place where sequences are aligned."""
    align: Literal["", "gps", "pairs"] = ""
    """gps or pairs: only frames of places that all sequences have, the same stem in all; by default every frame, and no
    stem in two sequences."""
    reference: str = ""
    """The sequence that the others are aligned with; by default the one with the fewest frames."""
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 10.0
    """Metres up to which two frames show the same place, for align=gps."""
    pairs: Path | None = None
    """CSV file of frames that show the same place, for align=pairs; columns are called like sequences."""
    gps: str = "gps/{set}/{video}.csv"
    """Where positions lie, in the source, with {set} and {video} in place of their names."""
    preset: Literal["", "paper"] = ""
    """paper: 1,600 training and 6,400 test places of six aligned sequences."""


def read(source: Path, options: Options) -> ForeignRoute:
    """Opens a copy of the data set.

    Raises:
        RouteError: It is not in a known form, is damaged, or lacks what an option needs.
        ConfigError: Two options do not go together.
    """
    _check(options)
    sequences = find_sequences(source, options.form, options.sequences)
    table = read_conditions(options.conditions)
    conditions = {sequence.key: condition_of(table, sequence.key) for sequence in sequences}
    if options.preset:
        _check_paper(source, conditions)
    poses, unplaced = _poses(source, sequences, options)
    chosen = {
        sequence.key: np.flatnonzero(np.isfinite(poses[sequence.key][:, 0]))
        if sequence.key in poses
        else np.arange(len(sequence))
        for sequence in sequences
    }
    notes = [_LICENCE, *(note for sequence in sequences for note in sequence.notes)]
    notes += [*_notes_on_conditions(conditions), *_notes_on_positions(sequences, poses), *unplaced]
    if options.align:
        counts = {key: len(frames) for key, frames in chosen.items()}
        chosen = _aligned(sequences, chosen, poses, options)
        notes.append(_note_on_places(counts, chosen))
    chosen = {key: frames[:: options.every] for key, frames in chosen.items()}
    if options.preset:
        chosen = _paper_places(source, chosen)
    return ForeignRoute(
        _traverses(sequences, conditions, chosen, poses, aligned=bool(options.align)),
        notes=tuple(notes),
        protocol=_PAPER_PROTOCOL if options.preset else "",
        truth_from=_truth_from(options, poses),
    )


def _truth_from(options: Options, poses: Mapping[str, NDArray[np.float64]]) -> str:
    """Says where the knowledge of which frames show the same place comes from; empty: there is none."""
    if options.pairs is not None:
        return f"the pairs of frames in {readable(options.pairs.name)}, set by hand"
    if options.align == "gps":
        return f"positions by GPS, within {options.radius:g} m"
    return "positions by GPS" if poses else ""


def _check(options: Options) -> None:
    """Raises `ConfigError` for options that do not go together."""
    if options.preset and not options.align:
        raise ConfigError("preset paper needs sequences that are aligned; add `align=gps` or `align=pairs`")
    if options.align == "pairs" and options.pairs is None:
        raise ConfigError("align=pairs needs the pairs; add `pairs=FILE.csv`")
    if options.pairs is not None and options.align != "pairs":
        raise ConfigError("pairs are of no use without `align=pairs`; add it, or leave the pairs out")


def _check_paper(source: Path, conditions: dict[str, str]) -> None:
    """Raises `RouteError` unless there are the paper's six sequences in its conditions."""
    if len(conditions) != _PAPER_SEQUENCES:
        raise RouteError(
            f"preset paper needs {_PAPER_SEQUENCES} sequences, but {readable(source)} gives {len(conditions)}; "
            "choose them with `sequences=setNN/VNNN,...`"
        )
    for key, condition in conditions.items():
        if condition not in _PAPER_CONDITIONS:
            raise RouteError(
                f"preset paper knows the conditions {', '.join(sorted(_PAPER_CONDITIONS))}, but that of {key} is "
                f"{condition or 'not known'}; say it with `conditions`={key}:night,..."
            )


def _paper_places(source: Path, chosen: dict[str, NDArray[np.int64]]) -> dict[str, NDArray[np.int64]]:
    """Takes 8,000 places, spread evenly over all; the paper does not say how it chose."""
    wanted = _PAPER_TRAINING + _PAPER_TEST
    places = len(next(iter(chosen.values())))
    if places < wanted:
        raise RouteError(
            f"preset paper needs {wanted} places, but the sequences of {readable(source)} share {places}; choose "
            "others, lower `every`, or raise `radius`"
        )
    positions = np.linspace(0, places - 1, wanted).round().astype(np.int64)
    return {key: frames[positions] for key, frames in chosen.items()}


def _poses(
    source: Path, sequences: Sequence[KaistSequence], options: Options
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Reads the poses of the sequences that have a GPS file, all in one plane, and says of which it holds no fix."""
    tracks: dict[str, GpsTrack] = {}
    for sequence in sequences:
        folder, _, video = sequence.key.partition("/")
        try:
            path = source / options.gps.format(set=folder, video=video)
        except (KeyError, ValueError, IndexError, AttributeError) as error:
            raise ConfigError(
                f"gps={options.gps!r} cannot be: write {{set}} and {{video}} in place of their names"
            ) from error
        if path.is_file():
            tracks[sequence.key] = read_gps(path)
        elif options.align == "gps":
            raise RouteError(f"align=gps needs {readable(path)}, which does not exist; set gps= or align by pairs")
    origins = [track.positions[0] for track in tracks.values() if track.degrees and len(track.positions)]
    origin = (float(origins[0][0]), float(origins[0][1])) if origins else (0.0, 0.0)
    poses: dict[str, NDArray[np.float64]] = {}
    notes: list[str] = []
    for sequence in sequences:
        track = tracks.get(sequence.key)
        if track is None:
            continue
        seconds = None if track.seconds is None else sequence.seconds()
        found = poses_on_track(track, sequence.frames, seconds, origin)
        if not track.lost or np.isfinite(found[:, 0]).any():
            poses[sequence.key] = found
        elif options.align == "gps":
            raise RouteError(
                f"align=gps needs positions, and {readable(track.path)} holds no fix (0, 0 is none) near a frame; "
                f"leave {sequence.key} out with sequences=, or align by pairs"
            )
        else:
            notes.append(f"{readable(track.path)} holds no fix near a frame: {sequence.key} gets no poses.")
    return poses, notes


def _aligned(
    sequences: Sequence[KaistSequence],
    chosen: dict[str, NDArray[np.int64]],
    poses: dict[str, NDArray[np.float64]],
    options: Options,
) -> dict[str, NDArray[np.int64]]:
    """Restricts the chosen frames to the places that all sequences have."""
    counts = {key: len(frames) for key, frames in chosen.items()}
    reference = options.reference or sparsest(counts)
    if reference not in counts:
        raise ConfigError(f"reference={reference!r} is no sequence; there are: {', '.join(counts)}")
    if options.pairs is not None:
        frames = {
            sequence.key: [sequence.frames[index] for index in chosen[sequence.key].tolist()] for sequence in sequences
        }
        places = align_all_by_pairs(counts, reference, read_pairs(options.pairs, reference, frames))
    else:
        positions = {key: poses[key][frames, :2] for key, frames in chosen.items()}
        places = align_all_by_position(positions, reference, options.radius)
    if not len(places[reference]):
        raise RouteError(f"the sequences {', '.join(counts)} share no place; raise `radius`, or choose others")
    return {key: frames[places[key]] for key, frames in chosen.items()}


def _traverses(
    sequences: Sequence[KaistSequence],
    conditions: dict[str, str],
    chosen: dict[str, NDArray[np.int64]],
    poses: dict[str, NDArray[np.float64]],
    *,
    aligned: bool,
) -> Iterator[ForeignTraverse]:
    for sequence in sequences:
        frames = chosen[sequence.key]
        digits = max(5, len(str(len(frames) - 1)))
        name = sequence.key.replace("/", "_")
        names = sequence.frames
        # Frames of one number in two drives that are not aligned show different places: they get different stems.
        stems = (
            f"{place:0{digits}d}" if aligned else f"{name}_{names[index]}"
            for place, index in enumerate(frames.tolist())
        )
        yield ForeignTraverse(
            name,
            _frames(sequence, frames, stems, poses.get(sequence.key)),
            condition=conditions[sequence.key],
            count=len(frames),
        )


def _frames(
    sequence: KaistSequence,
    indices: NDArray[np.int64],
    stems: Iterator[str],
    poses: NDArray[np.float64] | None,
) -> Iterator[ForeignFrame]:
    for index, stem, (content, seconds) in zip(indices.tolist(), stems, sequence.read(indices.tolist()), strict=True):
        pose = None if poses is None else Pose(*poses[index].tolist())
        yield ForeignFrame(stem, content, pose, None if math.isnan(seconds) else seconds)


def _notes_on_conditions(conditions: dict[str, str]) -> list[str]:
    unknown = [key for key, condition in conditions.items() if not condition]
    if not unknown:
        return []
    return [
        f"No condition is known for {', '.join(unknown)}: the traverse's name stands for it. Say it with "
        f"`conditions`={unknown[0]}:night,..."
    ]


def _notes_on_positions(sequences: Sequence[KaistSequence], poses: dict[str, NDArray[np.float64]]) -> list[str]:
    notes = []
    for sequence in sequences:
        if sequence.key in poses:
            lost = int((~np.isfinite(poses[sequence.key][:, 0])).sum())
            if lost == len(sequence):
                raise RouteError(
                    f"the GPS file of {sequence.key} covers none of its {len(sequence)} frames; check its names of "
                    "frames or its clock"
                )
            if lost:
                notes.append(f"{lost} of {len(sequence)} frames of {sequence.key} have no position and were left out.")
    return notes


def _note_on_places(before: dict[str, int], after: dict[str, NDArray[np.int64]]) -> str:
    parts = [f"{before[key] - len(frames)} of {before[key]} frames of {key}" for key, frames in after.items()]
    return f"{len(next(iter(after.values())))} places are in all sequences; without a partner: {', '.join(parts)}."
