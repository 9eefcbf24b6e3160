"""Decodes video files frame by frame, strictly: what cannot be decoded is told, not painted over.

FFmpeg's libraries (through PyAV) read the file through a Python file object and may open nothing else, so neither a
file's name nor a playlist in it leads anywhere.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.errors import EverplaceError, MissingExtraError, RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.images.decoding import MAX_PIXELS
from everplace.importing.containers.video_ends import ends_early

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

__all__ = ["ANEW", "VIDEO_ENDINGS", "DecodedFrame", "VideoAccount", "check_video", "last_frame_begins", "read_video"]

VIDEO_ENDINGS = frozenset(
    {".avi", ".m2ts", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".ts", ".webm", ".wmv"}
)
"""Endings (lower case) by which a file in a directory counts as a video."""

_BUFFER = 1 << 20
_ENDLESS = frozenset({"mpegts", "mpeg", "mpegvideo"})  # FFmpeg takes the last time in the file for their end
_MATRIX = struct.Struct("=ii4xii")
_NO_VIDEO = "is no video that can be read"

# A video that ends this much before the end it announces breaks off. Announced ends are no more exact than that; but
# of a file that was cut off every frame that is missing counts.
_SLACK_SECONDS = 1.0
_SLACK_FRAMES = 2.0


ANEW = "copy or export it again"
"""What helps where a file is damaged."""


class DecodedFrame(NamedTuple):
    """One frame of a video.

    Attributes:
        pixels: H×W×3 uint8 RGB, upright: the rotation and the mirror that the file asks for are applied.
        seconds: When it is shown, from the first frame on; None where the file has no times.
        lasts: For how many seconds it is shown; 0: not known.
    """

    pixels: NDArray[np.uint8]
    seconds: float | None
    lasts: float


class VideoAccount(NamedTuple):
    """What a video says of itself.

    Attributes:
        frames: How many it announces, if it does.
        seconds: How long it is by its own account, from the first frame on, if it says so.
        doubt: A sentence that says why it may not be whole; empty: there is no reason to think so.
    """

    frames: int | None
    seconds: float | None
    doubt: str


def check_video(path: Path) -> VideoAccount:
    """Opens a video without decoding it.

    Raises:
        RouteError: It is missing, empty or no video.
        MissingExtraError: PyAV is not installed.
    """
    with _naming_errors(path, _NO_VIDEO), _opened(path) as (container, stream):
        doubts = []
        end = _announced_end(container, stream)
        if container.format.name in _ENDLESS or end is None:
            doubts.append("does not announce where it ends, so whether it is whole cannot be checked")
        if ends_early(path):
            doubts.append("stops in the middle of its container, so it was cut off and frames may be missing")
        doubt = f"{readable(path)} {'; it '.join(doubts)}." if doubts else ""
        return VideoAccount(stream.frames or None, None if end is None else end - _start(stream), doubt)


def last_frame_begins(path: Path) -> float:
    """Says when the last frame of a video begins, in seconds from the first one on, by its own account.

    Nothing is decoded. A file that announces no length is read through for the times in it.

    Raises:
        RouteError: It is missing, empty or no video, or has no times.
        MissingExtraError: PyAV is not installed.
    """
    with _naming_errors(path, _NO_VIDEO), _opened(path) as (container, stream):
        end = _announced_end(container, stream)
        if end is not None:
            # The last frame is shown for as long as the others.
            return end - _start(stream) - _interval(stream)
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
    end = float("-inf")
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
                seconds, lasts = None, 0.0
                if frame.pts is not None and frame.time_base is not None:
                    first = frame.pts if first is None else first
                    last = seconds = float((frame.pts - first) * frame.time_base)
                    lasts = float((frame.duration or 0) * frame.time_base) or _interval(stream)
                    end = max(end, float(frame.pts * frame.time_base) + max(lasts, _interval(stream)))
                pixels = _upright(frame) if wanted(seconds) else None
            if pixels is not None:
                yield DecodedFrame(pixels, seconds, lasts)
            done += 1
        if not done:
            raise RouteError(f"{readable(path)} holds no frame that can be decoded; {ANEW}")
        if _breaks_off(container, stream, done, None if last is None else end, was_cut=ends_early(path)):
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
    refuse_pointer(path, RouteError)
    try:
        return path.open("rb")
    except OSError as error:
        raise RouteError(
            f"cannot read {readable(path)}: {error.strerror}; check the path and its permissions"
        ) from error


def _upright(frame: VideoFrame) -> NDArray[np.uint8]:
    """Converts to RGB, and turns and mirrors as the display matrix says, to the nearest of its eight cases."""
    pixels = np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
    matrix: Any = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return pixels
    # ISO/IEC 14496-12: a pixel at (x, y), y down, is shown at (a x + c y, b x + d y).
    a, b, c, d = _MATRIX.unpack_from(matrix)
    if abs(a) + abs(d) >= abs(b) + abs(c):
        left, up = a < 0, d < 0
    else:
        pixels = pixels.transpose(1, 0, 2)
        left, up = c < 0, b < 0
    return np.ascontiguousarray(pixels[:: -1 if up else 1, :: -1 if left else 1])


def _breaks_off(container: InputContainer, stream: VideoStream, done: int, end: float | None, *, was_cut: bool) -> bool:
    """Says whether a video that was read to its end announced more.

    Args:
        container: The file.
        stream: What was read of it.
        done: The number of frames.
        end: When the last of them ends, in the stream's time.
        was_cut: Whether the file was cut off.
    """
    announced = _announced_end(container, stream)
    if announced is None or end is None:
        # An MP4 counts frames that its edit list leaves out.
        return not container.format.name.startswith("mov") and done < stream.frames
    interval = _interval(stream)
    slack = max(_SLACK_SECONDS, _SLACK_FRAMES * interval)
    exact = was_cut and container.format.name not in _ENDLESS
    return end < announced - (interval / 2 if exact else slack)


def _announced_end(container: InputContainer, stream: VideoStream) -> float | None:
    """Returns when the last frame ends by the file's own account, in the stream's time.

    Lengths count from the first frame on, but in Matroska from 0, as FFmpeg writes them; where they count from the
    first frame there too, as mkvmerge writes them, the end is too early by the first frame's time, and refuses nothing.
    """
    start = 0.0 if container.format.name.startswith("matroska") else _start(stream)
    length = _own_length(stream)
    if length is None and container.duration is not None and len(container.streams) == 1:
        length = container.duration / 1_000_000
    return None if length is None else start + length


def _own_length(stream: VideoStream) -> float | None:
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    hours, _, rest = stream.metadata.get("DURATION", "").partition(":")  # Matroska: 00:00:02.000000000
    minutes, _, seconds = rest.partition(":")
    with contextlib.suppress(ValueError):
        return 3600 * int(hours) + 60 * int(minutes) + float(seconds)
    return None


def _interval(stream: VideoStream) -> float:
    """Returns the seconds from one frame to the next; 0: not known."""
    return 1 / float(stream.average_rate) if stream.average_rate else 0.0


def _start(stream: VideoStream) -> float:
    return float((stream.start_time or 0) * (stream.time_base or 0))


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
