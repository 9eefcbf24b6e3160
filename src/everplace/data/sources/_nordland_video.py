"""Nordland as the four videos of the journey: one frame a second."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from everplace.data.sources._nordland_names import season_of
from everplace.data.sources.protocol import ForeignFrame
from everplace.errors import MissingExtraError, RouteError
from everplace.files import readable

__all__ = ["VIDEO_ENDINGS", "VideoCopy"]

VIDEO_ENDINGS = (".mp4", ".mkv", ".mov", ".avi", ".webm", ".m4v", ".ts")
"""Endings (lower case) by which a file counts as a video."""

_LONGEST = 86_400  # seconds; the journey takes ten hours
_LONGEST_GAP = 2  # seconds without a frame: beyond, one frame would stand for too many places


class VideoCopy:
    """The videos, one a season; frame `images-00001` is the first, `images-00002` the one a second later.

    Attributes:
        stems: The frames of each season.
        tolerance: None.
        notes: How the frames were taken.
    """

    def __init__(self, source: Path, files: Sequence[Path], split: str) -> None:
        """Asks the videos how long they are.

        Raises:
            RouteError: A video cannot be read, has no season in its name, or two have the same.
            MissingExtraError: PyAV is not installed.
        """
        self.tolerance: int | None = None
        self._videos: dict[str, Path] = {}
        for path in files:
            season = season_of(path.stem) or season_of(path.absolute().parent.name)
            if not season:
                raise RouteError(f"the name of {readable(path)} tells no season; rename it like winter{path.suffix}")
            if season in self._videos:
                other = readable(self._videos[season])
                raise RouteError(f"{other} and {readable(path)} are both named after {season}; keep one of them")
            self._videos[season] = path
        self.stems = {season: _stems(_seconds(path)) for season, path in self._videos.items()}
        self.notes: tuple[str, ...] = (
            "One frame a second was taken from the videos, the first at or after each full second; lists and "
            "tables made for other copies may count a second differently.",
        )

    def read(self, season: str, stems: Sequence[str]) -> Iterator[ForeignFrame]:
        """Decodes a video to its end and keeps the frames that are wanted."""
        path = self._videos[season]
        wanted = set(stems)
        for second, pixels in _frames(path):
            stem = _stem(second)
            if stem in wanted:
                wanted.remove(stem)
                yield ForeignFrame(stem, pixels(), seconds=float(second))
            if not wanted:
                return
        raise RouteError(
            f"{readable(path)} ends before the frame {min(wanted)}, though it claims to be longer; fetch it again"
        )


def _stem(second: int) -> str:
    return f"images-{second + 1:05d}"


def _stems(seconds: int) -> list[str]:
    return [_stem(second) for second in range(seconds)]


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Opens a video and turns what breaks inside into one sentence."""
    try:
        import av
    except ImportError as error:
        raise MissingExtraError("reading videos", "video") from error
    try:
        # FFmpeg would take a name like `concat:...` for one of its own addresses; an open file it reads as it is.
        with path.open("rb") as file, av.open(file) as container:
            if not container.streams.video:
                raise RouteError(f"{readable(path)} holds no video; give the video files of the journey")
            yield container
    except (av.FFmpegError, ValueError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RouteError(f"{readable(path)} is damaged or no video ({reason}); fetch it again") from error


def _seconds(path: Path) -> int:
    """Returns the number of frames that one a second gives."""
    with _opened(path) as container:
        stream = container.streams.video[0]
        if stream.duration is not None and stream.time_base is not None:
            length = Fraction(stream.duration) * stream.time_base
        elif container.duration is not None:
            length = Fraction(container.duration, 1_000_000)
        else:
            times = [packet.pts for packet in container.demux(stream) if packet.pts is not None]
            length = Fraction(max(times) - min(times) + 1) * (stream.time_base or 1) if times else Fraction(0)
        rate = stream.average_rate or Fraction(25)
    # The last frame is shown for 1 / rate seconds: full second k exists if a frame begins at or after it.
    count = math.floor(float(length - 1 / rate) + 1e-6) + 1
    if not 0 < count <= _LONGEST:
        raise RouteError(f"{readable(path)} claims to be {float(length):.6g} seconds long; fetch it again")
    return count


def _frames(path: Path) -> Iterator[tuple[int, Any]]:
    """Yields each full second with what makes the pixels of the first frame at or after it."""
    with _opened(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        start: float | None = None
        second = 0
        for frame in container.decode(stream):
            if frame.time is None:
                continue
            start = frame.time if start is None else start
            if frame.is_corrupt:
                raise RouteError(f"{readable(path)} is damaged at second {frame.time - start:.0f}; fetch it again")
            if frame.time - start > second + _LONGEST_GAP:
                raise RouteError(f"{readable(path)} has a gap of several seconds at second {second}; fetch it again")
            while frame.time - start >= second - 1e-6:  # after a short gap one frame stands for two seconds
                yield second, lambda frame=frame: np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
                second += 1
