"""Piotr's `.seq` container: the frames of a recording one after the other in one file.

It is the container of StreamPix (Norpix) as Piotr's Computer Vision Toolbox reads and writes it, little-endian:

    0     u32        0xFEED
    4     24 bytes   "Norpix seq" in UTF-16
    28    i32        version; from 5 on the frames begin at 8192, before at 1024
    32    u32        length of the header, 1024
    36    512 bytes  description in UTF-16
    548   9 × u32    width, height, bits a pixel, true bits a channel (8), bytes a picture, format, number of frames
                     (0: not known), origin, bytes from one raw frame to the next
    584   f64        frames a second

    raw frame        picture, time stamp, padding up to the distance of frames
    JPEG, PNG frame  u32 length (itself included), the image file, time stamp, 0 or 8 bytes of padding
    time stamp       u32 seconds, u16 milliseconds, u16 microseconds (or padding)

A recording that was cut off keeps what is whole.
"""

from __future__ import annotations

import os
import stat
import struct
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from everplace.errors import RouteError
from everplace.files import readable
from everplace.git_lfs import refuse_pointer
from everplace.images.decoding import MAX_FILE_BYTES, MAX_PIXELS
from everplace.importing.foreign_route import Content, Encoded

__all__ = ["SeqFile", "SeqFrame", "open_seq"]

_HEADER = struct.Struct("<I24siI512x9Id")
_MAGIC = 0xFEED
_NAME = "Norpix seq".encode("utf-16-le")
_START, _LATE_START, _LATE_VERSION = 1024, 8192, 5
_STAMP = struct.Struct("<IHH")
_LENGTH = struct.Struct("<I")
_PADDINGS = (0, 8)
_RAW = {100: 1, 200: 3}  # channels: grey, and blue-green-red
_ENCODED = {102: ".jpg", 201: ".jpg", 1: ".png", 2: ".png"}
_SIGNATURES = {".jpg": b"\xff\xd8", ".png": b"\x89PNG\r\n\x1a\n"}


class SeqFrame(NamedTuple):
    """One frame.

    Attributes:
        content: The image file that the container holds, or H×W×1 grey or H×W×3 RGB pixels, uint8.
        seconds: When it was taken, from any fixed moment.
    """

    content: Content
    seconds: float


@dataclass(frozen=True)
class SeqFile:
    """A container whose frames were found, but not read.

    Attributes:
        path: The file.
        width: In pixels.
        height: In pixels.
        format: The code of the picture format: 100 grey, 200 blue-green-red, 102 and 201 JPEG, 1 and 2 PNG.
        fps: Frames a second, as the header says it; the time stamps are more reliable.
        missing: Frames that the header announces and the file does not hold whole.
        offsets: Where each frame begins, in bytes.
        lengths: The bytes of each picture or image file.
    """

    path: Path
    width: int
    height: int
    format: int
    fps: float
    missing: int
    offsets: array[int] = field(repr=False)
    lengths: array[int] = field(repr=False)

    def __len__(self) -> int:
        """Returns the number of whole frames."""
        return len(self.offsets)

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[SeqFrame]:
        """Reads frames, one in memory at a time; closing the iterator closes the file.

        Args:
            indices: Which frames, from 0 on; None: all in order.

        Raises:
            RouteError: The file changed since it was opened, or cannot be read.
        """
        with _opened(self.path) as file:
            for index in range(len(self)) if indices is None else indices:
                offset, length = self.offsets[index], self.lengths[index]
                data = _read(self.path, file, offset, length)
                stamp = _read(self.path, file, offset + length, _STAMP.size, at_least=6)
                yield SeqFrame(self._content(data), _seconds(stamp))

    def seconds(self) -> list[float]:
        """Reads the time stamps of all frames, but no picture.

        Raises:
            RouteError: As for `frames`.
        """
        with _opened(self.path) as file:
            return [
                _seconds(_read(self.path, file, offset + length, _STAMP.size, at_least=6))
                for offset, length in zip(self.offsets, self.lengths, strict=True)
            ]

    def _content(self, data: bytes) -> Content:
        if self.format in _ENCODED:
            return Encoded(data, _ENCODED[self.format])
        pixels = np.frombuffer(data, np.uint8).reshape(self.height, self.width, _RAW[self.format])
        return np.ascontiguousarray(pixels[:, :, ::-1])


def open_seq(path: Path) -> SeqFile:
    """Reads the header and finds the frames; of JPEG and PNG frames that needs one short read each.

    Args:
        path: The `.seq` file.

    Returns:
        The container; `missing` says how many announced frames are not whole.

    Raises:
        RouteError: The file cannot be read, is no such container, has pictures of a format that is not known
            here, or holds no whole frame; the message names the file and the remedy.
    """
    refuse_pointer(path, RouteError)
    with _opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        header = _read(path, file, 0, _HEADER.size, at_least=0)
        if len(header) < _HEADER.size or _LENGTH.unpack_from(header) != (_MAGIC,) or header[4:24] != _NAME:
            raise RouteError(
                f"{readable(path)} is no .seq container of StreamPix or Piotr's toolbox, or its first "
                "1024 bytes are damaged; copy it again"
            )
        _, _, version, _, width, height, _, depth, picture, code, announced, _, stride, fps = _HEADER.unpack(header)
        start = _LATE_START if version >= _LATE_VERSION else _START
        if code in _RAW:
            _check_raw(path, (width, height, _RAW[code]), depth, picture, stride)
            whole = max(0, (size - start + stride - picture - 6) // stride)
            count = min(whole, announced) if announced else whole
            offsets = array("Q", range(start, start + count * stride, stride))
            lengths = array("Q", [picture]) * count
        elif code in _ENCODED:
            offsets, lengths = _find_encoded(path, file, start, size, _SIGNATURES[_ENCODED[code]], announced)
        else:
            raise RouteError(
                f"{readable(path)} holds pictures of format {code}, but known are 100 and 200 (raw), 102 and 201 "
                "(JPEG), 1 and 2 (PNG); convert it with the recorder's software"
            )
    if not offsets:
        raise RouteError(f"{readable(path)} holds no whole frame; copy it again or leave it out")
    missing = max(0, announced - len(offsets))
    return SeqFile(path, width, height, code, fps, missing, offsets, lengths)


def _check_raw(path: Path, shape: tuple[int, int, int], depth: int, picture: int, stride: int) -> None:
    """Raises `RouteError` unless the numbers that locate raw frames fit together."""
    width, height, channels = shape
    if depth != 8 or not 0 < width * height <= MAX_PIXELS or picture != width * height * channels:
        raise RouteError(
            f"{readable(path)} says its raw pictures have {width}×{height} pixels of {channels} × {depth} bits in "
            f"{picture} bytes, which does not fit or is not read here; only 8 bits a channel are"
        )
    if stride < picture + 6:
        raise RouteError(
            f"{readable(path)} says {stride} bytes lie from one raw frame to the next, less than a frame of {picture} "
            "bytes and its time stamp; its header is damaged, copy it again"
        )


def _find_encoded(
    path: Path, file: BinaryIO, start: int, size: int, signature: bytes, announced: int
) -> tuple[array[int], array[int]]:
    """Follows the lengths from frame to frame, up to the first that is not whole.

    Whether 8 bytes of padding follow a time stamp depends on the program that wrote the file and, in some files,
    on the frame; the next frame's first bytes decide.
    """
    offsets, lengths = array("Q"), array("Q")

    def length_at(position: int) -> int:
        """The bytes of the image file of a whole frame that begins here, or 0."""
        beginning = _read(path, file, position, _LENGTH.size + len(signature), at_least=0)
        if len(beginning) < _LENGTH.size + len(signature) or not beginning.endswith(signature):
            return 0
        length = int(_LENGTH.unpack_from(beginning)[0]) - _LENGTH.size
        fits = len(signature) <= length <= MAX_FILE_BYTES and position + _LENGTH.size + length + 6 <= size
        return length if fits else 0

    position, length, padding = start, length_at(start), _PADDINGS[0]
    while length:
        offsets.append(position + _LENGTH.size)
        lengths.append(length)
        if len(offsets) == announced:
            break
        end = position + _LENGTH.size + length + _STAMP.size
        for trial in (padding, *(other for other in _PADDINGS if other != padding)):
            position, length = end + trial, length_at(end + trial)
            if length:
                padding = trial
                break
    return offsets, lengths


def _opened(path: Path) -> BinaryIO:
    """Opens a regular file; a pipe or device would block."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise RouteError(f"{readable(path)} is not a regular file; give a .seq file")
        return path.open("rb")
    except OSError as error:
        raise _unreadable(path, error) from error


def _read(path: Path, file: BinaryIO, position: int, length: int, at_least: int | None = None) -> bytes:
    """Reads so many bytes, or at the end of the file at least so many."""
    try:
        file.seek(position)
        data = file.read(length)
    except OSError as error:
        raise _unreadable(path, error) from error
    if len(data) < (length if at_least is None else at_least):
        raise RouteError(f"{readable(path)} became shorter while it was read; wait until it is copied, and try again")
    return data


def _unreadable(path: Path, error: OSError) -> RouteError:
    return RouteError(f"cannot read {readable(path)}: {error.strerror or error}; check the file and its permissions")


def _seconds(stamp: bytes) -> float:
    """Reads a time stamp; where microseconds cannot be, there is padding or the next frame."""
    seconds, milliseconds, microseconds = _STAMP.unpack(stamp.ljust(_STAMP.size, b"\0"))
    return float(seconds + milliseconds / 1000 + (microseconds / 1_000_000 if microseconds < 1000 else 0.0))
