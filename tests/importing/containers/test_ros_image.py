from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.fuzzing import fuzzed

from everplace.importing.containers.ros_image import ENCODINGS, image_pixels

RGB = np.random.default_rng(1).integers(0, 256, (4, 6, 3), dtype=np.uint8)


def read(
    encoding: str, pixels: NDArray[np.generic], padding: int = 0, *, big_endian: bool = False
) -> NDArray[np.uint8]:
    """Reads an array of pixels as the message that holds it."""
    rows = np.frombuffer(pixels.tobytes(), dtype=np.uint8).reshape(len(pixels), -1)
    step = rows.shape[1] + padding
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=77).reshape(-1)
    return image_pixels(encoding, len(pixels), pixels.shape[1], step, data, big_endian=big_endian)


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "stored"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[:, :, ::-1]),
        ("8UC3", RGB[:, :, ::-1]),
        ("rgba8", np.dstack([RGB, RGB[:, :, 0] // 2])),
        ("bgra8", np.dstack([RGB[:, :, ::-1], RGB[:, :, 0] // 2])),
        ("rgb16", RGB.astype("<u2") * 256 + 99),
        ("bgr16", RGB[:, :, ::-1].astype("<u2") * 256 + 99),
    ],
)
def test_colour(encoding: str, stored: NDArray[np.generic], padding: int) -> None:
    np.testing.assert_array_equal(read(encoding, stored, padding), RGB)


@pytest.mark.parametrize("padding", [0, 3])
def test_grey(padding: int) -> None:
    grey = RGB[:, :, :1]
    np.testing.assert_array_equal(read("mono8", grey, padding), grey)
    np.testing.assert_array_equal(read("8UC1", grey, padding), grey)
    sixteen = grey.astype(np.uint16) * 256 + 201
    np.testing.assert_array_equal(read("mono16", sixteen.astype("<u2"), padding), grey)
    np.testing.assert_array_equal(read("mono16", sixteen.astype(">u2"), padding, big_endian=True), grey)


@pytest.mark.parametrize("mosaic", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_a_mosaic_of_one_colour_becomes_that_colour(mosaic: str, bits: int) -> None:
    value = {"r": 200, "g": 120, "b": 40}
    cells = np.zeros((6, 8), dtype=np.uint16)
    for position, colour in enumerate(mosaic):
        cells[position // 2 :: 2, position % 2 :: 2] = value[colour]
    stored = cells.astype(np.uint8) if bits == 8 else cells * 256
    pixels = read(f"bayer_{mosaic}{bits}", stored)
    assert pixels.shape == (6, 8, 3)
    assert (pixels == [200, 120, 40]).all()


@pytest.mark.parametrize(("encoding", "luma"), [("yuv422", 1), ("yuv422_yuy2", 0)])
def test_yuv(encoding: str, luma: int) -> None:
    """Without colour, BT.601's video range 16 to 235 becomes 0 to 255."""
    stored = np.full((2, 4, 2), 128, dtype=np.uint8)
    stored[:, :, luma] = [16, 235, 16, 235]
    pixels = read(encoding, stored)
    assert (pixels == np.array([0, 255, 0, 255])[:, np.newaxis]).all()


def test_the_last_row_may_lack_its_padding() -> None:
    data = np.arange(11, dtype=np.uint8)  # two rows of 3 bytes, 8 apart
    assert image_pixels("mono8", 2, 3, 8, data, big_endian=False)[:, :, 0].tolist() == [[0, 1, 2], [8, 9, 10]]
    with pytest.raises(ValueError, match="10 bytes in rows of 8 are too few for 3×2 pixels"):
        image_pixels("mono8", 2, 3, 8, data[:10], big_endian=False)


@pytest.mark.parametrize(
    ("encoding", "height", "width", "step", "message"),
    [
        ("32FC1", 1, 1, 4, "the encoding '32FC1' is none of mono8"),
        ("rgb8", 2, 4, 11, "in rows of 11 are too few for 4×2 pixels of the encoding 'rgb8'"),
        ("mono8", 0, 4, 4, "4×0 pixels are not possible"),
        ("mono8", 2**16, 2**16, 2**16, "not possible"),
        ("yuv422", 2, 3, 6, "3 pixels a row are odd"),
        ("bayer_rggb8", 2, 2, 2, "too few for a colour mosaic"),
    ],
)
def test_fields_that_contradict_each_other(encoding: str, height: int, width: int, step: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        image_pixels(encoding, height, width, step, np.zeros(64, dtype=np.uint8), big_endian=False)


@fuzzed(100)
@given(
    encoding=st.sampled_from(ENCODINGS),
    height=st.integers(0, 9),
    width=st.integers(0, 9),
    step=st.integers(0, 80),
    data=st.binary(max_size=300),
    big_endian=st.booleans(),
)
def test_any_fields_give_pixels_or_one_error(
    encoding: str, height: int, width: int, step: int, data: bytes, big_endian: bool
) -> None:
    array = np.frombuffer(data, dtype=np.uint8)
    try:
        pixels = image_pixels(encoding, height, width, step, array, big_endian=big_endian)
    except ValueError as error:
        assert str(error)
    else:
        assert pixels.shape[:2] == (height, width)
        assert pixels.shape[2] in (1, 3)
        assert pixels.dtype == np.uint8
