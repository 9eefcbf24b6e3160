"""Nordland as the four videos of the journey: one frame a second."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.video_frames import last_frame_begins, read_video
from everplace.importing.foreign_route import ForeignFrame
from everplace.importing.sources._nordland_names import Copy, season_of

__all__ = ["open_videos"]

_LONGEST = 86_400  # seconds; the journey takes ten hours
_LONGEST_GAP = 2  # seconds without a frame: beyond, one frame would stand for too many places
_AT_ONCE = 1e-6  # seconds; times are fractions of the video's ticks


def open_videos(files: Sequence[Path]) -> Copy:
    """Opens the videos, one a season, and asks how long they are; `images-00002` is a second after `images-00001`.

    Raises:
        RouteError: A video cannot be read, has no season in its name, or two have the same.
        MissingExtraError: PyAV is not installed.
    """
    videos: dict[str, Path] = {}
    for path in files:
        season = season_of(path.stem) or season_of(path.absolute().parent.name)
        if not season:
            raise RouteError(f"the name of {readable(path)} tells no season; rename it like winter{path.suffix}")
        if season in videos:
            other = readable(videos[season])
            raise RouteError(f"{other} and {readable(path)} are both named after {season}; keep one of them")
        videos[season] = path
    return Copy(
        {season: _stems(path) for season, path in videos.items()},
        lambda season, stems: _frames(videos[season], stems),
        notes=(
            "One frame a second was taken from the videos, the first at or after each full second; lists and tables "
            "made for other copies may count a second differently.",
        ),
    )


def _frames(path: Path, stems: Sequence[str]) -> Iterator[ForeignFrame]:
    """Decodes a video as far as needed and keeps the frames that are wanted."""
    wanted = set(stems)
    second = 0

    def due(seconds: float | None) -> bool:
        return seconds is None or seconds >= second - _AT_ONCE

    for frame in read_video(path, due, "fetch it again"):
        if frame.seconds is None:
            raise RouteError(f"{readable(path)} does not say when its frames are shown; fetch it again")
        if frame.seconds > second + _LONGEST_GAP:
            raise RouteError(f"{readable(path)} has a gap of several seconds at second {second}; fetch it again")
        while due(frame.seconds):  # after a short gap one frame stands for two seconds
            stem = _stem(second)
            if stem in wanted:
                wanted.remove(stem)
                yield ForeignFrame(stem, frame.pixels, seconds=float(second))
            second += 1
        if not wanted:
            return
    raise RouteError(
        f"{readable(path)} ends before the frame {min(wanted)}, though it claims to be longer; fetch it again"
    )


def _stem(second: int) -> str:
    return f"images-{second + 1:05d}"


def _stems(path: Path) -> list[str]:
    """Returns the frames of a video: full second k has one if a frame begins at or after it."""
    last = last_frame_begins(path)
    if not 0 <= last <= _LONGEST:
        raise RouteError(f"{readable(path)} claims to be {last:.6g} seconds long; fetch it again")
    return [_stem(second) for second in range(math.floor(last + _AT_ONCE) + 1)]
