"""Decoding image files: strict, limited, silent, and always to the same kind of array.

Pillow decodes and OpenCV resizes. OpenCV's own decoders return the grey lower half of a truncated file as if
it were the picture, and print libjpeg's and libpng's warnings on stderr; Pillow refuses what is broken and
prints nothing.

What every decoded image has in common: the content decides the format, not the ending of the name; the EXIF
orientation is applied; 16-bit grey is divided by 256 (never stretched, which would hide how bright a frame
is); transparent pixels are laid over black; colour profiles are ignored; of an animation the first picture is
taken.
"""

from __future__ import annotations

import io
import os
import stat
import struct
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFile
from PIL.BmpImagePlugin import BmpImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.PpmImagePlugin import PpmImageFile
from PIL.TiffImagePlugin import TiffImageFile
from PIL.WebPImagePlugin import WebPImageFile

from everplace.errors import ConfigError, ImageError
from everplace.files import readable

__all__ = [
    "IMAGE_ENDINGS",
    "MAX_FILE_BYTES",
    "MAX_PIXELS",
    "ImageSpec",
    "decode_image",
    "decode_images",
    "read_image_bytes",
    "resize_image",
    "usable_cores",
]

IMAGE_ENDINGS = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
"""Endings (lower case) by which a file in a traverse counts as a frame."""

MAX_PIXELS = 2**26
"""Largest picture that is decoded: 8192×8192 pixels; checked in the header, before memory is taken."""

MAX_FILE_BYTES = 2**29
"""Largest image file that is read: 512 MiB."""

# The readers are called by the first bytes, not through Image.open: that one warns about large pictures on
# stderr before our own limit is asked, and tries every format it knows, some of which start other programs
# (EPS: Ghostscript).
_READERS: tuple[tuple[bytes, type[ImageFile.ImageFile]], ...] = (
    (b"\xff\xd8", JpegImageFile),
    (b"\x89PNG\r\n\x1a\n", PngImageFile),
    (b"BM", BmpImageFile),
    (b"II*\0", TiffImageFile),
    (b"II+\0", TiffImageFile),
    (b"MM\0*", TiffImageFile),
    (b"MM\0+", TiffImageFile),
    (b"RIFF", WebPImageFile),
    (b"P1", PpmImageFile),
    (b"P2", PpmImageFile),
    (b"P3", PpmImageFile),
    (b"P4", PpmImageFile),
    (b"P5", PpmImageFile),
    (b"P6", PpmImageFile),
)
_ORIENTATION_TAG = 0x0112


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


def decode_image(path: Path, spec: ImageSpec) -> NDArray[np.uint8]:
    """Decodes one image file.

    Grey conversion (ITU-R BT.601 luma) comes before resizing; shrinking averages areas, enlarging is
    bilinear. A JPEG whose target is at most half its size is decoded at 1/2, 1/4 or 1/8, never below the
    target.

    Args:
        path: The file; its name may hold bytes that are not UTF-8.
        spec: The wanted size and channels.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB), C-contiguous and writable.

    Raises:
        ImageError: The file is missing, unreadable, truncated, broken, too large, or no image.
    """
    data = read_image_bytes(path)
    if not data:
        raise ImageError(f"{readable(path)} is empty (0 bytes); copy or export the frame again")
    try:
        pixels = _decode(path, data, spec)
    # What Pillow's readers raise on broken bytes: OSError and EOFError where they end too early, SyntaxError
    # for broken PNG chunks, the others for header fields without sense.
    except (
        OSError,
        EOFError,
        SyntaxError,
        ValueError,
        TypeError,
        LookupError,
        OverflowError,
        struct.error,
    ) as error:
        raise ImageError(
            f"{readable(path)} is truncated or broken ({error}); copy or export the frame again"
        ) from error
    if spec.size is not None:
        pixels = resize_image(pixels, spec.size)
    return pixels


def decode_images(
    paths: Sequence[Path], spec: ImageSpec, *, threads: int | None = None
) -> Iterator[NDArray[np.uint8]]:
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
    threads = threads or min(8, usable_cores())
    pool = ThreadPoolExecutor(threads, thread_name_prefix="decode")
    ahead: deque[Future[NDArray[np.uint8]]] = deque()
    try:
        for path in paths:
            ahead.append(pool.submit(decode_image, path, spec))
            if len(ahead) > 2 * threads:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


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


def usable_cores() -> int:
    """Returns the number of cores this process may use (a container's share, where the system tells)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _decode(path: Path, data: bytes, spec: ImageSpec) -> NDArray[np.uint8]:
    """Decodes to H×W×C at the stored or a reduced size; raises what Pillow raises, or `ImageError`."""
    reader = next((reader for start, reader in _READERS if data.startswith(start)), None)
    if reader is None:
        raise ImageError(
            f"{readable(path)} is not an image of a known format; convert it to PNG or JPEG, "
            "or move it out of the route"
        )
    if reader is PngImageFile:
        _check_png(data)
    with reader(io.BytesIO(data)) as image:
        if image.width * image.height > MAX_PIXELS:
            raise ImageError(
                f"{readable(path)} has {image.width}×{image.height} pixels, more than the limit of "
                f"{MAX_PIXELS}; export the frame smaller"
            )
        if isinstance(image, JpegImageFile):
            _reduce_jpeg(image, spec)
        image.load()
        orientation = image.getexif().get(_ORIENTATION_TAG, 1)
        plain = _to_8_bit(path, image).convert("L" if spec.grey else "RGB")
        pixels = np.array(plain).reshape(plain.height, plain.width, spec.channels)
    return np.ascontiguousarray(_turn(pixels, orientation))


def _check_png(data: bytes) -> None:
    """Raises `ValueError` unless the chunks that make the picture are whole; Pillow skips their checksums."""
    position, kind = 8, b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, position)
        end = position + 8 + length
        (checksum,) = struct.unpack_from(">I", data, end)
        # A capital letter marks the chunks that matter; sloppy writers leave wrong checksums in others.
        if kind[:1].isupper() and zlib.crc32(memoryview(data)[position + 4 : end]) != checksum:
            raise ValueError(f"wrong checksum in chunk {kind!r}")
        position = end + 4


def _reduce_jpeg(image: JpegImageFile, spec: ImageSpec) -> None:
    """Tells the JPEG decoder to give fewer pixels, and only luma, where that is enough."""
    size = None
    if spec.size is not None:
        on_its_side = image.getexif().get(_ORIENTATION_TAG, 1) in {5, 6, 7, 8}
        size = spec.size if on_its_side else (spec.size[1], spec.size[0])
    image.draft("L" if spec.grey else "RGB", size)


def _to_8_bit(path: Path, image: Image.Image) -> Image.Image:
    """Brings any of Pillow's modes to L or RGB."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format in {"PNG", "PPM"}):
        return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    if image.mode in {"I", "F"}:
        raise ImageError(
            f"{readable(path)} has 32-bit pixels, whose range nobody knows; export the frame with 8 or 16 "
            "bits"
        )
    if image.mode == "L" and "transparency" not in image.info:
        return image
    if "A" in image.getbands() or "a" in image.getbands() or "transparency" in image.info:
        transparent = image.convert("RGBA")
        black = Image.new("RGB", image.size)
        black.paste(transparent, mask=transparent.getchannel("A"))
        return black
    return image.convert("RGB")


def _turn(pixels: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    """Applies an EXIF orientation (1 to 8; anything else is upright) to H×W×C."""
    match orientation:
        case 2:
            return pixels[:, ::-1]
        case 3:
            return pixels[::-1, ::-1]
        case 4:
            return pixels[::-1]
        case 5:
            return pixels.swapaxes(0, 1)
        case 6:
            return np.rot90(pixels, -1)
        case 7:
            return np.rot90(pixels, 2).swapaxes(0, 1)
        case 8:
            return np.rot90(pixels)
        case _:
            return pixels


def _uint8(array: object) -> NDArray[np.uint8]:
    """Names the type that OpenCV keeps but does not declare."""
    return np.asarray(array, dtype=np.uint8)
