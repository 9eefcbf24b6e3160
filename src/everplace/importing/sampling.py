"""Fewer frames of a recording: by number, by time, by the way travelled, or by change of the picture.

Each function takes a stream of frames and yields some of them, unchanged and in order; the first frame is always
kept, and only one picture is held.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from everplace.errors import ConfigError
from everplace.importing.foreign_route import ForeignFrame
from everplace.importing.frame_pixels import decode_content
from everplace.route.selection import FILTER_IMAGE, stationary_places

__all__ = ["TIME_ROUNDING", "sample_by_change", "sample_by_distance", "sample_by_number", "sample_by_time"]

TIME_ROUNDING = 1e-3
"""Seconds by which a frame may come before its moment: some containers round times to milliseconds."""

# A way shorter than this share of the wanted distance counts only once the frames after it go on from there:
# the jitter of a receiver that stands still is no way.
_JITTER = 0.1


def sample_by_number(frames: Iterator[ForeignFrame], every: int) -> Iterator[ForeignFrame]:
    """Keeps every n-th frame: numbers 0, n, 2n and so on."""
    for number, frame in enumerate(frames):
        if number % every == 0:
            yield frame


def sample_by_time(frames: Iterator[ForeignFrame], seconds: float) -> Iterator[ForeignFrame]:
    """Keeps the first frame of each span of time, counted from the first frame's time.

    The spans lie on a fixed grid, so that rounding does not add up, and drives that are in step stay so. A span
    without a frame gives none.

    Args:
        frames: Frames with times; one that goes back in time is left out.
        seconds: The length of a span.

    Raises:
        ConfigError: A frame has no time.
    """
    first: float | None = None
    reached = -1
    for frame in frames:
        if frame.seconds is None:
            raise ConfigError(
                f"every_seconds needs the time of each frame, and {frame.stem!r} has none; sample with every_frames"
            )
        if first is None:
            first = frame.seconds
        span = math.floor((frame.seconds - first + TIME_ROUNDING) / seconds)
        if span > reached:
            reached = span
            yield frame


def sample_by_distance(frames: Iterator[ForeignFrame], metres: float) -> Iterator[ForeignFrame]:
    """Keeps the first frame of each stretch of the way travelled, counted from the first frame's position.

    The stretches lie on a fixed grid, as the spans of `sample_by_time`. The way is the sum of moves of at least a
    tenth of a stretch, so that the jitter of positions at a stop does not count.

    Args:
        frames: Frames with poses.
        metres: The length of a stretch.

    Raises:
        ConfigError: A frame has no pose.
    """
    anchor: tuple[float, float] | None = None
    way = 0.0
    reached = -1
    for frame in frames:
        if frame.pose is None:
            raise ConfigError(
                f"every_metres needs the pose of each frame, and {frame.stem!r} has none; sample with every_seconds "
                "or every_frames"
            )
        position = (frame.pose.x, frame.pose.y)
        if anchor is None:
            anchor = position
        move = math.dist(position, anchor)
        if move >= _JITTER * metres:
            way += move
            anchor = position
        # Sums of moves such as 0.1 + 0.2 miss a whole number of stretches by a rounding error.
        stretch = math.floor(way / metres + 1e-9)
        if stretch > reached:
            reached = stretch
            yield frame


def sample_by_change(frames: Iterator[ForeignFrame], alike: float) -> Iterator[ForeignFrame]:
    """Keeps the frames that look different from the last one kept.

    The measure is the one of the filter for stationary places (`stationary_places`): the Pearson correlation of 64×32
    grey pixels.

    Args:
        frames: The frames.
        alike: Correlation from which, exclusive, a frame looks like the last one kept, and is left out.

    Raises:
        ImageError: An image cannot be decoded.
    """
    kept = None
    for frame in frames:
        scale = None if frame.scale is None else frame.scale.unused()
        grey = decode_content(frame._replace(scale=scale), FILTER_IMAGE)
        if kept is None or not stationary_places([np.stack([kept, grey])], above=alike)[1]:
            kept = grey
            yield frame
