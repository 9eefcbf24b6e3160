"""What folders, videos and bags have in common: sampling, size, names of frames and conditions."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.frame_names import counted_endings
from everplace.importing.foreign_route import (
    ForeignFrame,
    ForeignRoute,
    ForeignTraverse,
    ScaledOptions,
    is_placed,
)
from everplace.importing.frame_pixels import parse_size, resized, scaled
from everplace.importing.sampling import sample_by_change, sample_by_distance, sample_by_number, sample_by_time
from everplace.route.route_toml import RouteToml

__all__ = ["Drive", "RecordingOptions", "passed_over", "recorded_route"]

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

_SAMPLING = ("every_frames", "every_seconds", "every_metres", "change")


class RecordingOptions(ScaledOptions):
    """Options of every kind of recording."""

    every_frames: Annotated[int, Field(ge=1)] | None = None
    """Keep every n-th frame."""
    every_seconds: _Positive | None = None
    """Keep one frame in so many seconds."""
    every_metres: _Positive | None = None
    """Keep one frame in so many metres of the way travelled; needs poses."""
    change: Annotated[float, Field(ge=-1, lt=1)] | None = None
    """Keep a frame once its 64×32 grey picture correlates with that of the last one kept by no more than this; 0.95
    leaves out what a vehicle sees while it stands."""
    size: Annotated[tuple[int, int] | None, BeforeValidator(parse_size)] = None
    """Resize while reading, such as 320x240 (width × height); by default as stored."""
    conditions: tuple[Annotated[str, Field(min_length=1)], ...] = ()
    """The condition of each drive, in natural order of the drives' names; by default the names."""
    stems: Literal["shared", "own", "file"] = "shared"
    """shared numbers the frames of each drive from 000000 on, so that the i-th frames of all drives are the same place;
    own puts the drive's name before the number, for drives that are not in step; file keeps the names, or the numbers,
    that they have in the recording."""
    aligned: bool | None = None
    """Whether equal stems in two drives are the same place; true or false. By default they are, unless images of a
    route are read under their own names whose route.toml denies it."""
    pose_limit: _Positive = 0.5
    """Seconds up to which a pose may be away from the frame it is for; between two that are near enough it is
    interpolated."""
    without_pose: Literal["refuse", "drop"] = "refuse"
    """What to do where a recording has poses but none near a frame: refuse, or drop the frame. Frames at which a
    receiver says that it has no fix are left out in any case."""

    @model_validator(mode="after")
    def _one_sampling(self) -> RecordingOptions:
        given = [name for name in _SAMPLING if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(f"{given[0]} and {given[1]} exclude each other, keep one")
        return self


@dataclass(frozen=True)
class Drive:
    """One recording, before anything is left out.

    Attributes:
        name: What the traverse will be called.
        frames: All frames in order; closing it releases what it reads from. Those whose pose is `NOT_KNOWN` are left
            out, and the others keep their numbers.
        count: How many will come, if known.
        named: The stems of `frames` are names that stay; otherwise the frames that are kept are numbered.
    """

    name: str
    frames: Iterator[ForeignFrame]
    count: int | None = None
    named: bool = False


def passed_over(directory: Path, names: Sequence[str], what: str, endings: tuple[str, ...]) -> list[str]:
    """Returns a sentence that counts the files of known endings that were not read; none where there are none.

    Args:
        directory: Where they lie.
        names: The files in it that were not read.
        what: What they are, such as "videos".
        endings: Which endings (lower case) count, beginning with a dot.
    """
    told = counted_endings(names, endings)
    if not told:
        return []
    return [f"{readable(directory)} holds {what} that were not read: {told}; convert them, or give one by itself."]


def recorded_route(
    source: Path,
    drives: Sequence[Drive],
    options: RecordingOptions,
    notes: Sequence[str] = (),
    *,
    told: RouteToml | None = None,
) -> ForeignRoute:
    """Makes a route of recordings: samples, resizes and names their frames.

    Args:
        source: Where they come from.
        drives: At least one, in natural order of their names.
        options: What the user wants.
        notes: Sentences for the user.
        told: The route.toml of the route that the recordings are; None: they are none.

    Raises:
        ConfigError: There are not as many conditions as drives.
    """
    if options.conditions and len(options.conditions) != len(drives):
        raise ConfigError(
            f"`conditions` names {len(options.conditions)} conditions, but {readable(source)} holds {len(drives)} "
            f"drives: {', '.join(readable(drive.name) for drive in drives)}; name one for each, in this order"
        )
    conditions = options.conditions or tuple("" for _ in drives)
    said = list(notes)
    told = told or RouteToml()
    # Numbers that the import gives are others than those of which a route.toml speaks.
    aligned = (options.stems != "file" or told.aligned) if options.aligned is None else options.aligned
    in_step = aligned and options.stems != "own" and len(drives) > 1
    numbered = in_step and options.stems == "shared" and not all(drive.named for drive in drives)
    if numbered:
        said.append(
            "The frames of each drive are numbered from 000000 on, and the same number counts as the same place; for "
            "drives that are not in step, import with `stems=own` and align them."
        )
    return ForeignRoute(
        traverses=(
            ForeignTraverse(drive.name, _kept_frames(drive, options, said), condition, _kept_count(drive, options))
            for drive, condition in zip(drives, conditions, strict=True)
        ),
        notes=said,
        aligned=aligned,
        truth_from=_truth_from(told, numbered=numbered) if in_step else "",
        aligned_by=(told.aligned_by or "") if in_step else "",
    )


def _truth_from(told: RouteToml, *, numbered: bool) -> str:
    """Says where it comes from that equal stems are the same place: from what a route says of its own, if it does."""
    if told.truth_from and told.aligned and told.radius is None and told.truth is None:
        return told.truth_from
    return "equal numbers of frames, the drives taken to be in step" if numbered else "equal names of frames"


def _kept_frames(drive: Drive, options: RecordingOptions, notes: list[str]) -> Iterator[ForeignFrame]:
    """Yields the frames that stay, as they will be called, and notes how many had no position.

    Raises:
        RouteError: None stays, since none has a position.
    """
    prefix = f"{drive.name}-" if options.stems == "own" else ""
    lost = kept = 0

    def known(frames: Iterator[ForeignFrame]) -> Iterator[ForeignFrame]:
        nonlocal lost
        for frame in frames:
            if is_placed(frame):
                yield frame
            else:
                lost += 1

    # Where frames are compared, those that will not stay take no part. Elsewhere they count, and have a number, so that
    # drives which are in step stay so.
    compared = options.change is not None or options.every_metres is not None
    frames = scaled(known(drive.frames) if compared else drive.frames, options.scale())
    # The generators between here and the recording know nothing of closing it.
    with contextlib.ExitStack() as stack:
        stack.callback(getattr(drive.frames, "close", lambda: None))
        for number, frame in enumerate(resized(_sampled(frames, options), options.size)):
            if not is_placed(frame):
                lost += 1
                continue
            kept += 1
            stays = drive.named or options.stems == "file"
            yield frame._replace(stem=prefix + (frame.stem if stays else f"{number:06d}"))
    if lost and not kept:
        raise RouteError(
            f"no frame of {readable(drive.name)} has a position, since the receiver had no fix near any of them; "
            "import without positions, `poses=none`"
        )
    if lost:
        notes.append(
            f"Frames of {readable(drive.name)} that were left out, since the receiver had no fix near them: {lost}."
        )


def _sampled(frames: Iterator[ForeignFrame], options: RecordingOptions) -> Iterator[ForeignFrame]:
    if options.every_frames is not None:
        return sample_by_number(frames, options.every_frames)
    if options.every_seconds is not None:
        return sample_by_time(frames, options.every_seconds)
    if options.every_metres is not None:
        return sample_by_distance(frames, options.every_metres)
    if options.change is not None:
        return sample_by_change(frames, options.change)
    return frames


def _kept_count(drive: Drive, options: RecordingOptions) -> int | None:
    """Returns how many frames stay, if that can be known before they are read."""
    if drive.count is None or any(getattr(options, name) is not None for name in _SAMPLING[1:]):
        return None
    return -(-drive.count // (options.every_frames or 1))
