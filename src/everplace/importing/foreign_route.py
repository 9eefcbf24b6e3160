"""What a source of routes gives: traverses whose frames are read one by one, so that none is held in memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from everplace.images.sixteen_bits import SixteenBits
from everplace.route.traverse import Pose
from everplace.route.truth import TruthPair
from everplace.settings import Settings

__all__ = [
    "NOT_KNOWN",
    "Content",
    "Encoded",
    "ForeignFrame",
    "ForeignRoute",
    "ForeignTraverse",
    "ScaledOptions",
    "Source",
    "SourceOptions",
    "is_placed",
]

NOT_KNOWN = Pose(math.nan, math.nan, math.nan)
"""The pose of a frame near which a recording says that it did not know where it was: the frame is left out."""


class Encoded(NamedTuple):
    """An image file's content, from inside an archive or a recording.

    Attributes:
        data: The bytes of the file.
        ending: Its ending, dot included, such as `.jpg`.
    """

    data: bytes
    ending: str


Content: TypeAlias = Path | Encoded | NDArray[np.uint8]
"""A file that can stay where it is, an encoded image, or H×W×C pixels (C = 1 grey, 3 RGB)."""


class ForeignFrame(NamedTuple):
    """One frame as a source gives it.

    Attributes:
        stem: What it will be called; the same stem in two traverses is the same place. No `/`, not hidden.
        content: Its image.
        pose: Where it was taken, if the source knows.
        seconds: When it was taken, if the source knows, from any fixed moment.
        scale: How its 16-bit values become 8 bits, one for all frames of a drive; None: not said yet.
    """

    stem: str
    content: Content
    pose: Pose | None = None
    seconds: float | None = None
    scale: SixteenBits | None = None


def is_placed(frame: ForeignFrame) -> bool:
    """Whether a frame's pose is known, or nothing is said of it."""
    return frame.pose is None or not math.isnan(frame.pose.x)


@dataclass(frozen=True)
class ForeignTraverse:
    """One drive as a source gives it.

    Attributes:
        name: Name of its directory in the route.
        frames: Read once, in order; closing it releases what it reads from.
        condition: The condition; empty: the name.
        count: How many frames will come, for a progress bar; None: not known before.
    """

    name: str
    frames: Iterator[ForeignFrame]
    condition: str = ""
    count: int | None = None


@dataclass(frozen=True)
class ForeignRoute:
    """All that a source gives.

    Attributes:
        traverses: Opened one after the other; each is read to its end before the next is asked for.
        tolerance: Frames by which a match may be off, if the data set's protocol says so.
        radius: Metres by which a match may be off, if it says so; not beside `tolerance`.
        truth: Which frames show the same place, where neither stems nor poses tell it: read once, after the
            traverses, and every frame it names is in them; not beside `tolerance` or `radius`.
        notes: Sentences that the user should read: what was left out and why, licence, protocol; some may come while
            the traverses are read.
        protocol: The published protocol that chose the frames and the tolerance; empty: none.
        aligned: Whether equal stems in two traverses are the same place.
        truth_from: Where the knowledge of which frames show the same place comes from, as a part of a sentence; empty:
            the source does not tell.
        aligned_by: The method on whose descriptors the drives were aligned; empty: not by images.
    """

    traverses: Iterator[ForeignTraverse]
    tolerance: int | None = None
    radius: float | None = None
    truth: Iterator[TruthPair] | None = None
    notes: Sequence[str] = ()
    protocol: str = ""
    aligned: bool = True
    truth_from: str = ""
    aligned_by: str = ""


def _parse_range(value: object) -> object:
    """Reads `1700:3700`; leaves anything but text alone.

    Raises:
        ValueError: The text is no such range.
    """
    if not isinstance(value, str):
        return value
    sides = [int(side) for side in value.split(":") if side.isascii() and side.isdecimal() and len(side) < 6]
    if value.count(":") != 1 or len(sides) < 2 or not sides[0] < sides[1] <= 2**16:
        raise ValueError("it is not A:B with two whole numbers, 0 <= A < B <= 65536, like 1700:3700")
    return tuple(sides)


class SourceOptions(Settings):
    """Base of the options of a kind, given as `--set name=value`; the string under a field is its help."""


class ScaledOptions(SourceOptions):
    """Options of every kind whose images may have 16 bits."""

    range: Annotated[tuple[int, int] | None, BeforeValidator(_parse_range)] = None
    """The values of 16-bit frames that become black and white, such as 1700:3700, in all drives; by default 0:65536."""
    bits: Annotated[int, Field(ge=9, le=16)] | None = None
    """How many bits of 16-bit frames are used, such as 12 or 14; short for a range from 0 on."""

    @model_validator(mode="after")
    def _one_scale(self) -> ScaledOptions:
        if self.range is not None and self.bits is not None:
            raise ValueError("range and bits exclude each other, keep one")
        return self

    def scale(self) -> SixteenBits:
        """Returns the scale for one drive, which counts what it meets."""
        return SixteenBits(*(self.range or (0, 2 ** (self.bits or 16))))


class Source(Protocol):
    """A module of this package that reads one kind: it has these names.

    Attributes:
        SUMMARY: One line for `everplace data list`.
        Options: The kind's options.
    """

    SUMMARY: str
    Options: type[Any]

    def read(self, source: Path, options: Any) -> ForeignRoute:
        """Opens a source; frames are read later.

        Raises:
            RouteError: It is not of this kind, damaged, or empty; the message names the file and the remedy.
        """
        ...
