from __future__ import annotations

import importlib.util
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from PIL import Image
from tests.fuzzing import DAMAGE, Damage, fuzzed

from everplace.errors import EverplaceError, ImageError, MissingExtraError
from everplace.images import heif
from everplace.images.decoding import ImageSpec, decode_encoded, decode_image
from everplace.images.formats import image_ending, image_size

pillow_heif = pytest.importorskip("pillow_heif", reason="needs the extra heif")
pillow_heif.register_heif_opener()

PICTURE = np.kron(
    np.random.default_rng(4).integers(0, 256, (4, 6, 3), dtype=np.uint8), np.ones((24, 24, 1), dtype=np.uint8)
)


def encoded(form: str, pixels: NDArray[np.uint8] = PICTURE, orientation: int = 1) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, form, quality=95, exif=exif.tobytes())
    return buffer.getvalue()


@pytest.mark.parametrize("form", ["HEIF", "AVIF"])
@pytest.mark.parametrize("name", ["IMG_0001.HEIC", "IMG_0001.avif", "IMG_0001.jpg"])
def test_the_content_decides(tmp_path: Path, form: str, name: str) -> None:
    (tmp_path / name).write_bytes(encoded(form))
    pixels = decode_image(tmp_path / name, ImageSpec())
    assert pixels.shape == PICTURE.shape
    assert np.abs(pixels.astype(int) - PICTURE).mean() < 8
    assert decode_image(tmp_path / name, ImageSpec(size=(32, 48), grey=True)).shape == (32, 48, 1)
    assert image_ending(encoded(form)) == {"HEIF": ".heic", "AVIF": ".avif"}[form]


@pytest.mark.parametrize("form", ["HEIF", "AVIF"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_is_applied_once(form: str, orientation: int) -> None:
    plain = io.BytesIO()
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(PICTURE).save(plain, "PNG", exif=exif)
    wanted = decode_encoded("a", plain.getvalue(), ImageSpec())
    data = encoded(form, orientation=orientation)
    pixels = decode_encoded("a", data, ImageSpec())
    assert pixels.shape == wanted.shape == (*image_size("a", data), 3)
    assert np.abs(pixels.astype(int) - wanted).mean() < 8


@pytest.mark.parametrize("form", ["HEIF", "AVIF"])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(form: str, share: float) -> None:
    data = encoded(form)
    with pytest.raises(ImageError, match=r"a\.heic is truncated or broken"):
        decode_encoded("a.heic", data[: int(share * len(data))], ImageSpec())


@pytest.mark.parametrize("form", ["HEIF", "AVIF"])
def test_large_pictures_are_refused_by_their_header(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("everplace.images.formats.MAX_PIXELS", 1000)
    with pytest.raises(ImageError, match="144×96 pixels, more than the limit"):
        decode_encoded("a.heic", encoded(form), ImageSpec())


def test_what_is_missing_is_named_with_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heif, "_reads_avif", lambda: False)
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pillow_heif" else find(name))
    for form in ("HEIF", "AVIF"):
        with pytest.raises(MissingExtraError, match=r"IMG_1\.HEIC needs .* pip install 'everplace\[heif\]'"):
            decode_encoded("IMG_1.HEIC", encoded(form), ImageSpec())


def test_a_film_is_no_picture() -> None:
    with pytest.raises(ImageError, match="not an image of a known format"):
        decode_encoded("a.heic", b"\0\0\0\x18ftypisom\0\0\0\0isomavc1" + bytes(100), ImageSpec())


@fuzzed(60)
@given(DAMAGE)
@pytest.mark.parametrize("form", ["HEIF", "AVIF"])
def test_damaged_files_give_a_picture_or_one_error(form: str, damage: Damage) -> None:
    try:
        decode_encoded("a.heic", damage.of(encoded(form)), ImageSpec(size=(8, 8)))
    except EverplaceError as error:
        assert "a.heic" in str(error)
