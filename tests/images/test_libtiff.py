"""Broken compressed TIFFs are told of in one sentence, which is everplace's."""

from __future__ import annotations

import contextlib
import io

import numpy as np
import pytest
from PIL import Image

from everplace.errors import ImageError
from everplace.images.decoding import ImageSpec, decode_encoded


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "group4"])
def test_libtiff_writes_nothing(compression: str, capfd: pytest.CaptureFixture[str]) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (64, 64), dtype=np.uint8)
    image = Image.fromarray(pixels)
    file = io.BytesIO()
    (image.convert("1") if compression.startswith("group") else image).save(file, "TIFF", compression=compression)
    whole = file.getvalue()
    assert decode_encoded("whole.tiff", whole, ImageSpec()).shape == (64, 64, 3)
    broken = bytearray(whole)
    broken[100:260] = bytes(range(160))
    with contextlib.suppress(ImageError):  # libtiff mends some of what it complains of
        decode_encoded("broken.tiff", bytes(broken), ImageSpec())
    assert capfd.readouterr().err == ""
