"""The pixels of a frame's content, whatever form the source gives it in."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.files import readable
from everplace.images.decoding import ImageSpec, decode_encoded, decode_image, resize_image
from everplace.importing.foreign_route import Encoded, ForeignFrame

__all__ = ["decode_content", "parse_size", "resized"]

_LONGEST_SIDE = 8192


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
        return decode_encoded(f"the frame {readable(frame.stem)}", content.data, spec)
    return decode_image(content, spec)


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
