"""The pixels of a frame's content, whatever form the source gives it in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.errors import ImageError
from everplace.files import readable
from everplace.git_lfs import is_pointer, pointer_sentence
from everplace.images.decoding import (
    BROKEN_IMAGE_ERRORS,
    ImageSpec,
    decode_encoded,
    decode_image,
    read_image_bytes,
    resize_image,
)
from everplace.images.formats import may_have_16_bits, sixteen_bit_values
from everplace.images.sixteen_bits import SixteenBits
from everplace.importing.foreign_route import Content, Encoded, ForeignFrame

__all__ = ["decode_content", "parse_size", "resized", "scaled", "values_of_16_bits", "without_16_bits"]

_LONGEST_SIDE = 8192
_START_BYTES = 64


def decode_content(frame: ForeignFrame, spec: ImageSpec) -> NDArray[np.uint8]:
    """Decodes, greys and resizes the image of a frame.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB).

    Raises:
        ImageError: The image cannot be decoded.
    """
    content = frame.content
    if isinstance(content, np.ndarray):
        return _convert(content, spec)
    if isinstance(content, Encoded):
        return decode_encoded(_name(frame), content.data, spec, frame.scale)
    return decode_image(content, spec, frame.scale)


def scaled(frames: Iterator[ForeignFrame], scale: SixteenBits) -> Iterator[ForeignFrame]:
    """Says of frames how their 16-bit values become 8 bits, unless it is said already; closing it closes them."""
    try:
        for frame in frames:
            yield frame if frame.scale is not None else frame._replace(scale=scale)
    finally:
        getattr(frames, "close", lambda: None)()


def resized(frames: Iterator[ForeignFrame], size: tuple[int, int] | None) -> Iterator[ForeignFrame]:
    """Resizes frames while they are read; areas are averaged where they shrink.

    Args:
        frames: The frames.
        size: (H, W); None: as they are, not even decoded.

    Raises:
        ImageError: An image cannot be decoded.
    """
    if size is None:
        yield from frames
        return
    for frame in frames:
        grey = isinstance(frame.content, np.ndarray) and frame.content.shape[2] == 1
        yield frame._replace(content=decode_content(frame, ImageSpec(size, grey)))


def without_16_bits(frame: ForeignFrame) -> Content:
    """Returns a frame's content as it is, or as pixels where it has 16 bits and its scale does not take all of them.

    A scale that takes all of them is shown the values, so that it can tell how much of their range is used.

    Raises:
        ImageError: The image cannot be decoded, although it has to be, or is a pointer of Git LFS.
    """
    content, scale = frame.content, frame.scale
    if scale is None or isinstance(content, np.ndarray):
        return content
    if is_pointer(_start(content)):
        raise ImageError(pointer_sentence(_name(frame)))
    try:
        values = values_of_16_bits(frame)
    except ImageError:
        if scale.is_whole:  # whoever decodes the file will say what is wrong with it
            return content
        raise
    if values is None:
        return content
    if scale.is_whole:
        scale.to_8_bits(values)
        return content
    return decode_content(frame, ImageSpec(grey=values.ndim == 2))


def values_of_16_bits(frame: ForeignFrame) -> NDArray[np.uint16] | None:
    """Returns the values of a frame that is a file of 16 bits a value; None: it is none.

    Returns:
        H×W or H×W×3 (RGB) uint16.

    Raises:
        ImageError: The file may be one, but cannot be decoded.
    """
    if isinstance(frame.content, np.ndarray):
        return None
    try:
        data = _deep_file(frame.content)
        return None if data is None else sixteen_bit_values(_name(frame), data)
    except BROKEN_IMAGE_ERRORS as error:
        raise ImageError(f"{_name(frame)} is truncated or broken ({error}); copy or export it again") from error


def _deep_file(content: Path | Encoded) -> bytes | None:
    """Reads an image file that may hold 16-bit values; None: it does not.

    Raises:
        ImageError, OSError: It cannot be read.
    """
    if not may_have_16_bits(_start(content)):
        return None
    return content.data if isinstance(content, Encoded) else read_image_bytes(content)


def _start(content: Path | Encoded) -> bytes:
    """Returns the first bytes of an image file; none where it cannot be read."""
    if isinstance(content, Encoded):
        return content.data[:_START_BYTES]
    try:
        if not content.is_file():  # a device or FIFO would be waited for
            return b""
        with content.open("rb") as file:
            return file.read(_START_BYTES)
    except OSError:
        return b""


def _name(frame: ForeignFrame) -> str:
    """What to call a frame's file in messages."""
    return readable(frame.content) if isinstance(frame.content, Path) else f"the frame {readable(frame.stem)}"


def parse_size(value: object) -> object:
    """Reads `64x32` (width × height) as (H, W), for a field of options; leaves anything but text alone.

    Raises:
        ValueError: The text is no such size.
    """
    if not isinstance(value, str):
        return value
    width, _, height = value.lower().replace("×", "x").partition("x")
    sides = [int(side) for side in (height, width) if side.isascii() and side.isdecimal() and len(side) < 6]
    if len(sides) < 2 or not all(0 < side <= _LONGEST_SIDE for side in sides):
        raise ValueError("it is not WIDTHxHEIGHT in pixels, like 64x32")
    return tuple(sides)


def _convert(pixels: NDArray[np.uint8], spec: ImageSpec) -> NDArray[np.uint8]:
    """Brings H×W×1 or H×W×3 pixels to a spec: grey first (ITU-R BT.601 luma), then the size, as for files."""
    if spec.grey and pixels.shape[2] == 3:
        pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), dtype=np.uint8)[:, :, np.newaxis]
    elif not spec.grey and pixels.shape[2] == 1:
        pixels = np.repeat(pixels, 3, axis=2)
    return pixels if spec.size is None else resize_image(pixels, spec.size)
