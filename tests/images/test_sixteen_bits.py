from __future__ import annotations

import io

import cv2
import numpy as np
import pytest
from hypothesis import given
from PIL import Image
from tests.fuzzing import DAMAGE, Damage, fuzzed

from everplace.errors import ImageError
from everplace.images.decoding import ImageSpec, decode_encoded
from everplace.images.sixteen_bits import SixteenBits, used_range


def test_all_16_bits_give_the_upper_halves() -> None:
    values = np.arange(0, 65536, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(SixteenBits().to_8_bits(values), values >> 8)


@pytest.mark.parametrize("bits", [9, 12, 14, 16])
def test_a_scale_from_0_on_is_a_shift(bits: int) -> None:
    values = np.arange(0, 2**bits, dtype=np.uint16)[np.newaxis]
    np.testing.assert_array_equal(SixteenBits(0, 2**bits).to_8_bits(values), values >> (bits - 8))


def test_what_lies_outside_becomes_black_or_white() -> None:
    values = np.array([[0, 999, 1000, 1500, 1999, 2000, 65535]], dtype=np.uint16)
    assert SixteenBits(1000, 2000).to_8_bits(values).tolist() == [[0, 0, 0, 128, 255, 255, 255]]


def test_a_hot_and_a_dead_pixel_are_no_range() -> None:
    values = np.tile(np.arange(3000, 4000, dtype=np.uint16), (4, 1))
    values[0, 0], values[0, 1] = 0, 65535
    low, high = used_range([values, values])
    assert 3000 <= low < 3010
    assert 3990 < high < 4000


def test_frames_are_counted_and_told() -> None:
    scale = SixteenBits()
    wide = np.linspace(0, 65535, 400).astype(np.uint16).reshape(20, 20)
    scale.to_8_bits(wide)
    scale.to_8_bits(wide // 32 + 100)
    scale.to_8_bits(wide // 32 + 50)
    (note,) = scale.notes("winter")
    assert "2 of 3 16-bit frames of winter use less than a sixteenth" in note
    assert "values 50 to 2147" in note
    assert "`range=50:2148`" in note


def test_values_that_are_cut_off_and_an_option_without_effect_are_told() -> None:
    scale = SixteenBits(0, 1024)
    scale.to_8_bits(np.full((4, 4), 5000, dtype=np.uint16))
    assert "1 of 1 16-bit frames of day have more than 1% of their values outside 0:1024" in scale.notes("day")[0]
    assert "No frame of day has 16 bits" in SixteenBits(0, 1024).notes("day")[0]
    assert SixteenBits().notes("day") == []


COLOURS = np.random.default_rng(5).integers(0, 4096, (16, 24, 3), dtype=np.uint16)


def encoded(form: str) -> bytes:
    kind, ending = form.split()
    if kind == "colour":
        return cv2.imencode(ending, COLOURS)[1].tobytes()
    buffer = io.BytesIO()
    Image.fromarray(COLOURS[:, :, 0]).save(buffer, {".png": "PNG", ".tiff": "TIFF", ".pgm": "PPM"}[ending])
    return buffer.getvalue()


@fuzzed(40)
@given(DAMAGE)
@pytest.mark.parametrize("form", ["grey .png", "grey .tiff", "grey .pgm", "colour .png", "colour .tiff"])
@pytest.mark.parametrize("high", [4096, 65536])
def test_damaged_files_give_a_picture_or_one_error(form: str, high: int, damage: Damage) -> None:
    try:
        decode_encoded("a.png", damage.of(encoded(form)), ImageSpec(), SixteenBits(0, high))
    except ImageError as error:
        assert "a.png" in str(error)
