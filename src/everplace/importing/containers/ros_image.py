"""Pixels of `sensor_msgs/Image`, in the encodings that cameras use.

8 bits a channel stay as they are; of 16 bits the upper 8 are taken, or a scale, as for image files; alpha is dropped,
which in a camera's image says nothing; colour mosaics and YUV 4:2:2 become RGB.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.images.decoding import MAX_PIXELS
from everplace.images.sixteen_bits import SixteenBits

__all__ = ["ENCODINGS", "image_pixels"]


class _Layout(NamedTuple):
    """How an encoding stores a pixel.

    Attributes:
        channels: Values a pixel.
        bits: 8 or 16.
        order: Which values are red, green and blue, or grey.
        conversion: OpenCV's name of what makes RGB of it; empty: picking `order` is enough.
    """

    channels: int
    bits: int
    order: tuple[int, ...]
    conversion: str = ""


_COLOUR = {"rgb": (3, (0, 1, 2)), "bgr": (3, (2, 1, 0)), "rgba": (4, (0, 1, 2)), "bgra": (4, (2, 1, 0))}
# ROS names a mosaic by the first two rows. OpenCV names it by the second and third pixel of the second row.
_MOSAICS = {"rggb": "BayerBG2RGB", "bggr": "BayerRG2RGB", "gbrg": "BayerGR2RGB", "grbg": "BayerGB2RGB"}

_LAYOUTS: dict[str, _Layout] = {
    "mono8": _Layout(1, 8, (0,)),
    "8UC1": _Layout(1, 8, (0,)),
    "mono16": _Layout(1, 16, (0,)),
    "8UC3": _Layout(3, 8, (2, 1, 0)),
    **{f"{name}{bits}": _Layout(n, bits, order) for name, (n, order) in _COLOUR.items() for bits in (8, 16)},
    **{f"bayer_{name}{bits}": _Layout(1, bits, (0,), code) for name, code in _MOSAICS.items() for bits in (8, 16)},
    "yuv422": _Layout(2, 8, (0, 1), "YUV2RGB_UYVY"),
    "uyvy": _Layout(2, 8, (0, 1), "YUV2RGB_UYVY"),
    "yuv422_yuy2": _Layout(2, 8, (0, 1), "YUV2RGB_YUYV"),
    "yuyv": _Layout(2, 8, (0, 1), "YUV2RGB_YUYV"),
}

ENCODINGS = tuple(_LAYOUTS)
"""The encodings that can be read."""


def image_pixels(
    encoding: str,
    height: int,
    width: int,
    step: int,
    data: NDArray[np.uint8],
    *,
    big_endian: bool,
    scale: SixteenBits | None = None,
) -> NDArray[np.uint8]:
    """Makes pixels of the fields of a message.

    Args:
        encoding: One of `ENCODINGS`.
        height: Rows.
        width: Pixels a row.
        step: Bytes a row, padding included.
        data: At least height × step bytes; the padding of the last row may be missing.
        big_endian: The byte order of 16-bit values.
        scale: How 16-bit values become 8 bits; None: their upper 8 bits count.

    Returns:
        H×W×C uint8, C = 1 (grey) or 3 (RGB), C-contiguous.

    Raises:
        ValueError: The encoding is not known, or the fields contradict each other.
    """
    layout = _LAYOUTS.get(encoding)
    if layout is None:
        raise ValueError(f"the encoding {encoding[:40]!r} is none of {', '.join(ENCODINGS)}")
    bytes_of_row = width * layout.channels * layout.bits // 8
    if min(height, width) < 1 or height * width > MAX_PIXELS:
        raise ValueError(f"{width}×{height} pixels are not possible (the limit is {MAX_PIXELS} in all)")
    if step < bytes_of_row or len(data) < (height - 1) * step + bytes_of_row:
        raise ValueError(
            f"{len(data)} bytes in rows of {step} are too few for {width}×{height} pixels of the encoding {encoding!r}"
        )
    if layout.conversion.startswith("YUV") and width % 2:
        raise ValueError(f"{width} pixels a row are odd, which the encoding {encoding!r} does not allow")
    if layout.conversion.startswith("Bayer") and min(height, width) < 3:
        raise ValueError(f"{width}×{height} pixels are too few for a colour mosaic")
    rows = np.lib.stride_tricks.as_strided(data, (height, bytes_of_row), (step * data.itemsize, data.itemsize))
    values = rows.reshape(height, width, layout.channels, layout.bits // 8)
    if layout.bits == 16 and scale is not None:
        upper = scale.to_8_bits(np.ascontiguousarray(values).view(">u2" if big_endian else "<u2")[..., 0])
    else:
        upper = values[..., 0 if big_endian else -1]
    if layout.conversion:
        import cv2

        converted = cv2.cvtColor(np.ascontiguousarray(upper), getattr(cv2, f"COLOR_{layout.conversion}"))
        return np.asarray(converted, dtype=np.uint8)
    return np.ascontiguousarray(upper[..., list(layout.order)])
