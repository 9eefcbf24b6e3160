"""Warnings of the libraries that decode images name the file, once."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from everplace.warning_source import file_of_warning, warnings_of

PICTURE = np.random.default_rng(3).integers(0, 256, (16, 24, 3), dtype=np.uint8)


def jpeg_whose_exif_ends_early() -> bytes:
    exif = Image.Exif()
    exif[0x0112] = 6
    buffer = io.BytesIO()
    Image.fromarray(PICTURE).save(buffer, "JPEG", exif=exif)
    data = bytearray(buffer.getvalue())
    data[data.index(b"Exif\0\0") + 15] = 200  # tags announced
    return bytes(data)


def jpeg_whose_exif_points_outside() -> bytes:
    exif = Image.Exif()
    exif[0x010F] = "a camera's maker"
    buffer = io.BytesIO()
    Image.fromarray(PICTURE).save(buffer, "JPEG", exif=exif)
    data = bytearray(buffer.getvalue())
    data[data.index(b"Exif\0\0") + 21] = 200  # length of the text, upper bytes
    return bytes(data)


def tiff_whose_tag_has_two_values() -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(PICTURE).save(buffer, "TIFF")
    data = bytearray(buffer.getvalue())
    data[data.index(b"\x1c\x01\x03\0\x01\0\0\0") + 4] = 2  # PlanarConfiguration
    return bytes(data)


def described(directory: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "everplace", *more],
        cwd=directory, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip


@pytest.mark.parametrize(
    "make", [jpeg_whose_exif_ends_early, jpeg_whose_exif_points_outside, tiff_whose_tag_has_two_values]
)
@pytest.mark.parametrize("command", [["describe", "hog", "day", "--out", "a.h5"], ["data", "inspect", "."]])
def test_a_warning_names_the_first_file_once(tmp_path: Path, make: Callable[[], bytes], command: list[str]) -> None:
    (tmp_path / "day").mkdir()
    for number in range(12):
        (tmp_path / f"day/{number}.jpg").write_bytes(make())
    done = described(tmp_path, *command)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if "EXIF" in line or "tag" in line]
    assert len(said) == 1
    assert ".jpg: " in said[0]
    assert "everplace: " in said[0]


def test_opencv_says_nothing_of_a_tag_in_16_bit_colours(tmp_path: Path) -> None:
    data = bytearray(cv2.imencode(".tiff", PICTURE.astype(np.uint16) * 9)[1].tobytes())
    at = int.from_bytes(data[4:8], "little")
    entries = int.from_bytes(data[at : at + 2], "little")
    whole = bytes(data[at + 2 : at + 2 + 12 * entries])
    unknown = (65000).to_bytes(2, "little") + b"\x03\0\x01\0\0\0\x05\0\0\0"
    data[4:8] = len(data).to_bytes(4, "little")
    data += (entries + 1).to_bytes(2, "little") + whole + unknown + bytes(4)
    (tmp_path / "day").mkdir()
    (tmp_path / "day/a.tiff").write_bytes(data)
    done = described(tmp_path, "data", "import", "images", "day", "--out", "out", "--set", "bits=12")
    assert done.returncode == 0, done.stderr
    assert "WARN" not in done.stderr


def test_the_name_ends_with_the_block() -> None:
    with warnings_of("a.jpg"):
        assert file_of_warning() == "a.jpg"
        with warnings_of("b.jpg"):
            assert file_of_warning() == "b.jpg"
    assert file_of_warning() == ""
