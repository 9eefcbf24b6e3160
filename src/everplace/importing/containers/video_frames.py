"""Decodes video files frame by frame, strictly: what cannot be decoded is told, not painted over.

FFmpeg's libraries (through PyAV) read the file through a Python file object and may open nothing else, so neither a
file's name nor a playlist in it leads anywhere.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import EverplaceError, MissingExtraError, RouteError
from everplace.files import readable
from everplace.images.decoding import MAX_PIXELS

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

__all__ = ["ANEW", "VIDEO_ENDINGS", "DecodedFrame", "check_video", "last_frame_begins", "read_video"]

VIDEO_ENDINGS = frozenset(
    {".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".ts", ".webm", ".wmv"}
)
"""Endings (lower case) by which a file in a directory counts as a video."""

_BUFFER = 1 << 20
_NO_VIDEO = "is no video that can be read"

# A file that ends this much before the end it announces was cut off. Announced ends are no more exact than that.
_SLACK_SECONDS = 1.0
_SLACK_FRAMES = 2.0


ANEW = "copy or export it again"
"""What helps where a file is damaged."""


class DecodedFrame(NamedTuple):
    """One frame of a video.

    Attributes:
        pixels: H×W×3 uint8 RGB, upright: the rotation that the file asks for is applied.
        seconds: When it is shown, from the first frame on; None where the file has no times.
    """

    pixels: NDArray[np.uint8]
    seconds: float | None


def check_video(path: Path) -> int | None:
    """Opens a video without decoding it.

    Returns:
        How many frames it announces, if it does.

    Raises:
        RouteError: It is missing, empty or no video.
        MissingExtraError: PyAV is not installed.
    """
    with _naming_errors(path, _NO_VIDEO), _opened(path) as (_, stream):
        return stream.frames or None


def last_frame_begins(path: Path) -> float:
    """Says when the last frame of a video begins, in seconds from the first one on, by its own account.

    Nothing is decoded. A file that announces no length is read through for the times in it.

    Raises:
        RouteError: It is missing, empty or no video, or has no times.
        MissingExtraError: PyAV is not installed.
    """
    with _naming_errors(path, _NO_VIDEO), _opened(path) as (container, stream):
        length = _announced_seconds(container, stream)
        if length is not None:
            # The last frame is shown for as long as the others.
            return length - (1 / float(stream.average_rate) if stream.average_rate else 0.0)
        times = [packet.pts for packet in container.demux(stream) if packet.pts is not None]
        if times and stream.time_base is not None:
            return float((max(times) - min(times)) * stream.time_base)
    raise RouteError(f"{readable(path)} does not say when its frames are shown; {ANEW}")


def read_video(
    path: Path, wanted: Callable[[float | None], bool] = lambda _: True, broken: str = ANEW
) -> Iterator[DecodedFrame]:
    """Decodes a video from its beginning to its end.

    Args:
        path: The file.
        wanted: Asked with the seconds of each frame whether it is yielded; the others cost no conversion to RGB.
        broken: What to do, in the error, where the video breaks off.

    Raises:
        RouteError: The file cannot be read, or breaks off: a frame is damaged, or it ends before the end that it
            announces. The wanted frames before that have been yielded.
        MissingExtraError: PyAV is not installed.
    """
    done, last = 0, None
    with _naming_errors(path, _NO_VIDEO):
        opened = contextlib.ExitStack()
        container, stream = opened.enter_context(_opened(path))
    first: int | None = None
    with opened:
        frames = container.decode(stream)
        while True:
            damage = (f"is damaged {_after(done, last)}", broken) if done else ("holds no frame that can be decoded",)
            with _naming_errors(path, *damage):
                frame = next(frames, None)
                if frame is None:
                    break
                if frame.is_corrupt:
                    raise ValueError("a frame is marked as corrupt")
                seconds = None
                if frame.pts is not None and frame.time_base is not None:
                    first = frame.pts if first is None else first
                    last = seconds = float((frame.pts - first) * frame.time_base)
                pixels = _upright(frame) if wanted(seconds) else None
            if pixels is not None:
                yield DecodedFrame(pixels, seconds)
            done += 1
        if not done:
            raise RouteError(f"{readable(path)} holds no frame that can be decoded; {ANEW}")
        if _is_cut_off(container, stream, done, last):
            raise RouteError(f"{readable(path)} breaks off {_after(done, last)}; {broken}")


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    try:
        import av
        from av.container import InputContainer
    except ImportError as error:
        raise MissingExtraError("reading videos", "video") from error
    # Damage is an error, not a patch of the frame before; larger pictures than images may have are refused
    # before memory is taken.
    strict = {"err_detect": "crccheck+bitstream+buffer+explode", "max_pixels": str(MAX_PIXELS)}
    with (
        _open_file(path) as file,
        av.open(file, buffer_size=_BUFFER, options={"protocol_whitelist": "none"}) as container,
    ):
        stream = container.streams.best("video")
        if not isinstance(stream, av.VideoStream) or not isinstance(container, InputContainer):
            raise RouteError(f"{readable(path)} holds no video stream; give a video file")
        stream.codec_context.options = strict
        stream.thread_type = "AUTO"
        yield container, stream


def _open_file(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise RouteError(
            f"cannot read {readable(path)}: {error.strerror}; check the path and its permissions"
        ) from error


def _upright(frame: VideoFrame) -> NDArray[np.uint8]:
    """Converts to RGB and turns; the file's rotation is counter-clockwise, in degrees."""
    pixels = np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
    quarters = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(pixels, quarters)) if quarters else pixels


def _is_cut_off(container: InputContainer, stream: VideoStream, done: int, last: float | None) -> bool:
    """Says whether a video that was read to its end announced more."""
    # An MP4 counts frames that its edit list leaves out.
    if not container.format.name.startswith("mov") and done < stream.frames:
        return True
    announced = _announced_seconds(container, stream)
    if announced is None or last is None:
        return False
    interval = 1 / float(stream.average_rate) if stream.average_rate else 0.0
    return last + interval < announced - max(_SLACK_SECONDS, _SLACK_FRAMES * interval)


def _announced_seconds(container: InputContainer, stream: VideoStream) -> float | None:
    """Returns how long the video is by its own account."""
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    hours, _, rest = stream.metadata.get("DURATION", "").partition(":")  # Matroska: 00:00:02.000000000
    minutes, _, seconds = rest.partition(":")
    with contextlib.suppress(ValueError):
        return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    if container.duration is not None and len(container.streams) == 1:
        return container.duration / 1_000_000
    return None


def _after(done: int, last: float | None) -> str:
    return f"after {done} frames" + ("" if last is None else f", at {last:.2f} s")


@contextlib.contextmanager
def _naming_errors(path: Path, problem: str, remedy: str = ANEW) -> Iterator[None]:
    """Turns whatever FFmpeg's libraries raise into one sentence."""
    try:
        yield
    except EverplaceError:
        raise
    except Exception as error:
        what = getattr(error, "strerror", None) or str(error).partition("\n")[0] or type(error).__name__
        raise RouteError(f"{readable(path)} {problem} ({what}); {remedy}") from error
