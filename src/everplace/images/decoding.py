"""Decoding image files: strict, limited, silent, and always to the same kind of array.

Pillow decodes and OpenCV resizes. OpenCV's own decoders return the grey lower half of a truncated file as if it
were the picture, and print libjpeg's and libpng's warnings on stderr; Pillow refuses what is broken, in silence
(`libtiff` sees to that of compressed TIFFs). `formats` says how each format becomes 8-bit grey or RGB.
"""

from __future__ import annotations

import os
import stat
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from everplace.errors import ConfigError, ImageError
from everplace.files import readable
from everplace.images.formats import MAX_PIXELS, decode_bytes
from everplace.images.heif import HEIF_ENDINGS
from everplace.images.sixteen_bits import SixteenBits
from everplace.threads import map_ahead

__all__ = [
    "BROKEN_IMAGE_ERRORS",
    "IMAGE_ENDINGS",
    "MAX_FILE_BYTES",
    "MAX_PIXELS",
    "ImageSpec",
    "convert_image",
    "decode_encoded",
    "decode_image",
    "decode_images",
    "is_image_name",
    "read_image_bytes",
    "resize_image",
]

IMAGE_ENDINGS = frozenset(
    {".bmp", ".jfif", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp", *HEIF_ENDINGS}
)
"""Endings (lower case) by which a file in a traverse counts as a frame."""

_ENDINGS = tuple(sorted(IMAGE_ENDINGS))

BROKEN_IMAGE_ERRORS = (
    OSError,
    EOFError,
    SyntaxError,
    ValueError,
    TypeError,
    LookupError,
    OverflowError,
    RuntimeError,
    struct.error,
)
"""What Pillow's readers raise on broken bytes: OSError and EOFError where they end too early, SyntaxError for
broken PNG chunks, RuntimeError for broken AVIF, the others for header fields without sense."""

MAX_FILE_BYTES = 2**29
"""Largest image file that is read: 512 MiB."""


@dataclass(frozen=True, slots=True)
class ImageSpec:
    """How a method wants its images.

    Attributes:
        size: (H, W) in pixels; the picture is stretched to it. None: as stored.
        grey: One grey channel instead of three colour channels.
    """

    size: tuple[int, int] | None = None
    grey: bool = False

    def __post_init__(self) -> None:
        """Raises `ConfigError` for a size that no image can have."""
        if self.size is not None and (min(self.size) < 1 or self.size[0] * self.size[1] > MAX_PIXELS):
            raise ConfigError(
                f"image size {self.size[0]}×{self.size[1]} is not possible; "
                f"give a height and a width of at least 1 pixel and at most {MAX_PIXELS} pixels in all"
            )

    @property
    def channels(self) -> int:
        """1 for grey, 3 for colour (RGB order)."""
        return 1 if self.grey else 3


def decode_image(path: Path, spec: ImageSpec, scale: SixteenBits | None = None) -> NDArray[np.uint8]:
    """Decodes one image file.

    Grey conversion (ITU-R BT.601 luma) comes before resizing; shrinking averages areas, enlarging is
    bilinear. A JPEG whose target is at most half its size is decoded at 1/2, 1/4 or 1/8, never below the
    target.

    Args:
        path: The file; its name may hold bytes that are not UTF-8.
        spec: The wanted size and channels.
        scale: How 16-bit values become 8 bits; None: their upper 8 bits count.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB), C-contiguous and writable.

    Raises:
        ImageError: The file is missing, unreadable, truncated, broken, too large, or no image.
        MissingExtraError: It is HEIC or AVIF, and what reads that is not installed.
    """
    return decode_encoded(readable(path), read_image_bytes(path), spec, scale)


def decode_encoded(name: str, data: bytes, spec: ImageSpec, scale: SixteenBits | None = None) -> NDArray[np.uint8]:
    """Decodes the content of an image file, from wherever it comes; see `decode_image`.

    Args:
        name: What to call it in messages.
        data: The whole file.
        spec: The wanted size and channels.
        scale: How 16-bit values become 8 bits; None: their upper 8 bits count.

    Raises:
        ImageError: It is empty, truncated, broken, too large, or no image.
    """
    if not data:
        raise ImageError(f"{name} is empty (0 bytes); copy or export the frame again")
    try:
        pixels = decode_bytes(name, data, spec.size, grey=spec.grey, scale=scale)
    except BROKEN_IMAGE_ERRORS as error:
        raise ImageError(f"{name} is truncated or broken ({error}); copy or export the frame again") from error
    if spec.size is not None:
        pixels = resize_image(pixels, spec.size)
    return pixels


def convert_image(image: NDArray[np.uint8], spec: ImageSpec) -> NDArray[np.uint8]:
    """Gives an image that lies in memory the size and channels of a spec, as `decode_image` does with a file.

    Args:
        image: H×W or H×W×1 grey, or H×W×3 RGB, uint8.
        spec: The wanted size and channels.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB); a new array.

    Raises:
        ImageError: The array is no such image.
    """
    image = np.asarray(image)
    if image.dtype != np.uint8 or image.shape[2:] not in {(), (1,), (3,)} or image.ndim < 2 or not image.size:
        raise ImageError(
            f"an image must be H×W (grey) or H×W×3 (RGB) numbers of uint8, not {image.dtype} of {image.shape}; "
            "convert it, and give several as a list"
        )
    plain = Image.fromarray(image[..., 0] if image.shape[2:] == (1,) else image).convert("L" if spec.grey else "RGB")
    pixels = np.array(plain).reshape(plain.height, plain.width, spec.channels)
    return pixels if spec.size is None else resize_image(pixels, spec.size)


def decode_images(paths: Sequence[Path], spec: ImageSpec, *, threads: int | None = None) -> Iterator[NDArray[np.uint8]]:
    """Decodes many image files in order, some ahead of the reader.

    Args:
        paths: The files.
        spec: The wanted size and channels.
        threads: Decoding threads; None: one for each usable core, at most 8. Two images a thread are held
            ahead.

    Yields:
        What `decode_image` returns, in the order of `paths`.

    Raises:
        ImageError: When the reader reaches a file that cannot be decoded.
    """
    return map_ahead(lambda path: decode_image(path, spec), paths, threads=threads)


def is_image_name(name: str) -> bool:
    """Says whether a file's name ends as an image's does, in capitals or not."""
    return name.lower().endswith(_ENDINGS)


def read_image_bytes(path: Path) -> bytes:
    """Reads a whole file that is to be an image.

    Raises:
        ImageError: It is missing, unreadable, larger than `MAX_FILE_BYTES`, or a pipe, device or directory
            (which would block or never end).
    """
    try:
        status = os.stat(path)  # noqa: PTH116 - half the time of Path.stat, and this runs for every frame
        if not stat.S_ISREG(status.st_mode):
            raise ImageError(f"{readable(path)} is not a regular file; move it out of the route")
        if status.st_size > MAX_FILE_BYTES:
            raise ImageError(
                f"{readable(path)} has {status.st_size} bytes, more than the limit of {MAX_FILE_BYTES}; "
                "export the frame smaller or compressed"
            )
        with open(path, "rb") as file:  # noqa: PTH123
            return file.read()
    except OSError as error:
        raise ImageError(
            f"cannot read {readable(path)}: {error.strerror or error}; check the file and its permissions"
        ) from error


def resize_image(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Stretches an image to a size: areas are averaged where it shrinks, bilinear where it grows.

    Args:
        image: H×W×C uint8.
        size: The new (H, W).

    Returns:
        size[0]×size[1]×C uint8, C-contiguous; `image` itself when it has that size already.
    """
    height, width = image.shape[:2]
    smaller = (min(height, size[0]), min(width, size[1]))
    # Two steps: cv2's INTER_AREA falls back to plain interpolation on both axes as soon as one of them grows.
    if smaller != (height, width):
        image = _uint8(cv2.resize(image, (smaller[1], smaller[0]), interpolation=cv2.INTER_AREA))
    if smaller != size:
        image = _uint8(cv2.resize(image, (size[1], size[0]), interpolation=cv2.INTER_LINEAR))
    return image if image.ndim == 3 else image[:, :, np.newaxis]


def _uint8(array: object) -> NDArray[np.uint8]:
    """Names the type that OpenCV keeps but does not declare."""
    return np.asarray(array, dtype=np.uint8)
