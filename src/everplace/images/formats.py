"""The formats of images, read by Pillow, and how each becomes 8-bit grey or RGB.

What every decoded image has in common: the content decides the format, not the ending of the name; the EXIF
orientation is applied; 16-bit values are divided by 256, or scaled as their whole drive is (never each frame by
itself, which would hide how bright it is); transparent pixels are laid over black, but an alpha of 0 throughout,
which simulators write, is none; colour profiles are ignored; of an animation the first picture is taken.
"""

from __future__ import annotations

import io
import struct
import zlib

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

from everplace.errors import ImageError
from everplace.git_lfs import POINTER_BYTES, is_pointer, pointer_sentence
from everplace.images.heif import heif_ending, heif_reader
from everplace.images.libtiff import silence_libtiff
from everplace.images.sixteen_bits import SixteenBits
from everplace.warning_source import warnings_of

__all__ = [
    "MAX_PIXELS",
    "announced_pixels",
    "decode_bytes",
    "image_ending",
    "image_size",
    "may_have_16_bits",
    "sixteen_bit_values",
]

MAX_PIXELS = 2**26
"""Largest picture that is decoded: 8192×8192 pixels; checked in the header, before memory is taken."""

# The readers are called by the first bytes, not through Image.open: that one warns about large pictures on
# stderr before our own limit is asked, and tries every format it knows, some of which start other programs
# (EPS: Ghostscript).
_READERS: tuple[tuple[bytes, type[ImageFile.ImageFile], str], ...] = (
    (b"\xff\xd8", JpegImageFile, ".jpg"),
    (b"\x89PNG\r\n\x1a\n", PngImageFile, ".png"),
    (b"BM", BmpImageFile, ".bmp"),
    *((start, TiffImageFile, ".tiff") for start in (b"II*\0", b"II+\0", b"MM\0*", b"MM\0+")),
    (b"RIFF", WebPImageFile, ".webp"),
    *((b"P%d" % number, PpmImageFile, ".ppm") for number in range(1, 7)),
)
_PNG_BITS, _PNG_START = 24, 25
_ORIENTATION_TAG = 0x0112
_WIDTH_TAG, _HEIGHT_TAG = 0x0100, 0x0101
_BITS_TAG = 0x0102
# Nobody hides a whole picture: such an alpha was never set, or was 1.0 before it became a byte.
_NO_ALPHA = 1
_ON_ITS_SIDE = frozenset({5, 6, 7, 8})
# What each EXIF orientation asks for; 1 and anything else is upright.
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


def decode_bytes(
    name: str, data: bytes, target: tuple[int, int] | None, *, grey: bool, scale: SixteenBits | None = None
) -> NDArray[np.uint8]:
    """Decodes an image at its stored size, or a JPEG at 1/2, 1/4 or 1/8 of it.

    Args:
        name: What to call the image in messages.
        data: The whole file.
        target: (H, W) that the picture will be resized to: a reduced JPEG is never below it. None: as stored.
        grey: One channel of ITU-R BT.601 luma instead of three of RGB.
        scale: How 16-bit values become 8 bits; None: their upper 8 bits count.

    Returns:
        H×W×C uint8, C-contiguous.

    Raises:
        ImageError: The format is unknown, the picture too large, or its pixels have no known range.
        MissingExtraError: It is HEIC or AVIF, and what reads that is not installed.
        OSError, EOFError, SyntaxError, ValueError, TypeError, LookupError, OverflowError, RuntimeError, struct.error:
            What Pillow's readers raise on broken bytes.
    """
    with warnings_of(name), _open(name, data) as image:
        if isinstance(image, JpegImageFile):
            _reduce_jpeg(image, target, grey)
        deep = scale is not None and _has_16_bits(image, data)
        image.load()
        orientation = image.getexif().get(_ORIENTATION_TAG, 1)
        plain = _scaled(image, data, scale) if deep and scale is not None else None
        plain = (plain or _to_8_bit(name, image)).convert("L" if grey else "RGB")
        if orientation in _TURNS:
            plain = plain.transpose(_TURNS[orientation])
        return np.array(plain).reshape(plain.height, plain.width, 1 if grey else 3)


def image_ending(data: bytes) -> str:
    """Returns the usual ending of image files that begin so, such as `.jpg`; empty: the format is unknown."""
    return next((ending for start, _, ending in _READERS if data.startswith(start)), "") or heif_ending(data[:64])


def image_size(name: str, data: bytes) -> tuple[int, int]:
    """Returns the (H, W) of the upright picture, as its header says; errors as `decode_bytes`."""
    with warnings_of(name), _find_reader(name, data)(io.BytesIO(data)) as image:
        on_its_side = image.getexif().get(_ORIENTATION_TAG, 1) in _ON_ITS_SIDE
        width, height = image.size
        if isinstance(image, TiffImageFile):  # versions of Pillow differ in whether its size is upright already
            width, height = image.tag_v2[_WIDTH_TAG], image.tag_v2[_HEIGHT_TAG]
        return (width, height) if on_its_side else (height, width)


def may_have_16_bits(start: bytes) -> bool:
    """Says by the first 32 bytes of an image file whether it may hold 16-bit values."""
    ending = image_ending(start)
    return start[_PNG_BITS:_PNG_START] == b"\x10" if ending == ".png" else ending in {".tiff", ".ppm"}


def sixteen_bit_values(name: str, data: bytes) -> NDArray[np.uint16] | None:
    """Returns the values of an image file that holds 16 bits a value; None: it does not.

    Returns:
        H×W or H×W×3 (RGB) uint16, as stored, before any turn.

    Raises:
        ImageError, OSError and others: As `decode_bytes`.
    """
    with warnings_of(name), _open(name, data) as image:
        if not _has_16_bits(image, data):
            return None
        image.load()
        return _values(image, data)


def _open(name: str, data: bytes) -> ImageFile.ImageFile:
    """Reads the header, and checks what can be checked before memory is taken; errors as `decode_bytes`."""
    reader = _find_reader(name, data)
    if reader is PngImageFile:
        _check_png(data)
    if reader is TiffImageFile:
        silence_libtiff()
    image = reader(io.BytesIO(data))
    if image.width * image.height > MAX_PIXELS:
        raise ImageError(
            f"{name} has {image.width}×{image.height} pixels, more than the limit of "
            f"{MAX_PIXELS}; export the frame smaller"
        )
    return image


def _has_16_bits(image: ImageFile.ImageFile, data: bytes) -> bool:
    """Says of an image that is not loaded yet whether its values may use any part of 16 bits."""
    if isinstance(image, PngImageFile):
        return data[_PNG_BITS] == 16
    if isinstance(image, TiffImageFile):
        return set(image.tag_v2.get(_BITS_TAG, ())) == {16} and image.mode in {"I;16", "I;16B", "I;16L", "RGB", "RGBA"}
    # Of a PGM that says its largest value Pillow makes 16 whole bits; colour has none left.
    return image.mode == "I" and isinstance(image, PpmImageFile) and image.tile[0][0] == "raw"


def _scaled(image: ImageFile.ImageFile, data: bytes, scale: SixteenBits) -> Image.Image | None:
    """Scales 16-bit values; None where the scale takes all of them, so that only their range is of interest."""
    try:
        pixels = scale.to_8_bits(_values(image, data))
    except ValueError:
        if scale.is_whole:
            return None
        raise
    return None if scale.is_whole else Image.fromarray(pixels)


def _values(image: ImageFile.ImageFile, data: bytes) -> NDArray[np.uint16]:
    """Returns the 16-bit values of an image, which Pillow has decoded and so found whole."""
    if image.mode.startswith("I"):
        return np.asarray(image).astype(np.uint16)
    # Pillow keeps the upper 8 bits of colours. OpenCV prints its warnings of tags, which name no file, on stderr.
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        colours = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError("its 16-bit colours cannot be read") from error
    finally:
        cv2.utils.logging.setLogLevel(level)
    if colours is None or colours.dtype != np.uint16:
        raise ValueError("its 16-bit colours cannot be read")
    rgb = colours[:, :, 2::-1] if colours.ndim == 3 else colours
    return np.ascontiguousarray(rgb, dtype=np.uint16)


def announced_pixels(start: bytes) -> int:
    """Returns how many pixels the header of an image announces; errors as `decode_bytes`.

    Args:
        start: The beginning of the file; of a TIFF all of it, whose header may stand at its end.
    """
    with _find_reader("the image", start)(io.BytesIO(start)) as image:
        return image.width * image.height


def _find_reader(name: str, data: bytes) -> type[ImageFile.ImageFile]:
    """Returns what reads files that begin like this one.

    Raises:
        ImageError: Nothing does.
        MissingExtraError: Nothing that is installed does.
    """
    reader = next((reader for start, reader, _ in _READERS if data.startswith(start)), None)
    if reader is None and (ending := heif_ending(data[:64])):
        return heif_reader(name, ending)
    if reader is None and is_pointer(data[:POINTER_BYTES]):
        raise ImageError(pointer_sentence(name))
    if reader is None:
        raise ImageError(
            f"{name} is not an image of a known format; convert it to PNG or JPEG, or move it out of the route"
        )
    return reader


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


def _reduce_jpeg(image: JpegImageFile, target: tuple[int, int] | None, grey: bool) -> None:
    """Tells the JPEG decoder to give fewer pixels, and only luma, where that is enough."""
    size = None
    if target is not None:
        on_its_side = image.getexif().get(_ORIENTATION_TAG, 1) in _ON_ITS_SIDE
        size = target if on_its_side else (target[1], target[0])
    image.draft("L" if grey else "RGB", size)


def _to_8_bit(name: str, image: Image.Image) -> Image.Image:
    """Brings any of Pillow's modes to L or RGB."""
    if image.mode.startswith("I;16") or (image.mode == "I" and image.format in {"PNG", "PPM"}):
        return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    if image.mode in {"I", "F"}:
        raise ImageError(f"{name} has 32-bit pixels, whose range nobody knows; export the frame with 8 or 16 bits")
    if image.mode == "L" and "transparency" not in image.info:
        return image
    if "A" in image.getbands() or "a" in image.getbands() or "transparency" in image.info:
        transparent = image.convert("RGBA")
        if np.asarray(transparent.getchannel("A")).max() <= _NO_ALPHA:
            return transparent.convert("RGB")
        black = Image.new("RGB", image.size)
        black.paste(transparent, mask=transparent.getchannel("A"))
        return black
    return image.convert("RGB")
