from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.errors import ConfigError, ImageError
from everplace.files import readable
from everplace.images import decoding as images
from everplace.images.decoding import ImageSpec, convert_image, decode_image, decode_images, resize_image
from everplace.images.formats import image_size

COLOUR = ImageSpec()
GREY = ImageSpec(grey=True)


def landscape(height: int = 40, width: int = 60, channels: int = 3) -> NDArray[np.uint8]:
    """A smooth picture without symmetry, so that JPEG keeps it and every turn shows."""
    y, x = np.mgrid[0:height, 0:width]
    stack = [40 + 150 * x / width, 60 + 120 * y / height, 200 - 90 * (x * y) / (height * width)]
    return np.stack(stack[:channels], axis=2).round().astype(np.uint8)


def encoded(picture: Image.Image, kind: str, **options: object) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, kind, **options)
    return buffer.getvalue()


def png_chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def hollow_png(height: int, width: int) -> bytes:
    """A PNG whose header promises any size, with next to no data."""
    header = png_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + png_chunk(b"IDAT", zlib.compress(b"")) + png_chunk(b"IEND", b"")


@pytest.mark.parametrize("kind", ["PNG", "BMP", "TIFF", "PPM", "WEBP"])
def test_lossless_formats_give_the_stored_pixels(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "frame.img"
    path.write_bytes(encoded(Image.fromarray(landscape()), kind, **({"lossless": True} if kind == "WEBP" else {})))

    pixels = decode_image(path, COLOUR)

    np.testing.assert_array_equal(pixels, landscape())
    assert pixels.dtype == np.uint8
    assert pixels.flags.c_contiguous
    assert pixels.flags.writeable


def test_grey_is_luma_and_one_channel(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Image.fromarray(landscape()).save(path)

    pixels = decode_image(path, GREY)

    assert pixels.shape == (40, 60, 1)
    luma = landscape() @ np.array([0.299, 0.587, 0.114])
    assert np.abs(pixels[:, :, 0] - luma).max() <= 0.51


def test_grey_file_as_colour_repeats_the_channel(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    Image.fromarray(landscape(channels=1)[:, :, 0]).save(path)
    np.testing.assert_array_equal(decode_image(path, COLOUR), np.repeat(landscape(channels=1), 3, axis=2))


def test_colours_are_in_rgb_order(tmp_path: Path) -> None:
    path = tmp_path / "red.png"
    Image.new("RGB", (4, 2), (255, 0, 0)).save(path)
    assert decode_image(path, COLOUR)[0, 0].tolist() == [255, 0, 0]


def test_content_decides_not_the_ending(tmp_path: Path) -> None:
    path = tmp_path / "really_a_png.jpg"
    path.write_bytes(encoded(Image.fromarray(landscape()), "PNG"))
    np.testing.assert_array_equal(decode_image(path, COLOUR), landscape())


def test_jpeg_is_decoded_reduced_but_never_below_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.jpg"
    Image.fromarray(landscape(480, 640)).save(path, quality=95)
    sizes: list[tuple[int, ...]] = []
    resize = images.resize_image

    def spy(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
        sizes.append(image.shape[:2])
        return resize(image, size)

    monkeypatch.setattr(images, "resize_image", spy)
    targets = [(241, 320), (240, 320), (100, 320), (120, 160), (119, 160), (32, 64), (480, 640)]
    pixels = [decode_image(path, ImageSpec(size=size)) for size in targets]

    assert sizes == [(480, 640), (240, 320), (240, 320), (120, 160), (120, 160), (60, 80), (480, 640)]
    for target, image in zip(targets, pixels, strict=True):
        true = resize(landscape(480, 640), target)
        assert np.abs(image.astype(int) - true).mean() < 2.5


def test_cmyk_jpeg_becomes_rgb(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.new("CMYK", (16, 16), (0, 255, 255, 0)).save(path, quality=95)
    red = decode_image(path, COLOUR)[8, 8]
    assert red[0] > 200
    assert red[1:].max() < 60
    assert decode_image(path, GREY).shape == (16, 16, 1)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "PPM"])
@pytest.mark.parametrize("spec", [GREY, COLOUR])
def test_16_bit_grey_is_scaled_over_the_whole_range(tmp_path: Path, kind: str, spec: ImageSpec) -> None:
    values = np.array([[0, 255, 256, 32768, 65280, 65535]], dtype=np.uint16)
    path = tmp_path / "thermal"
    path.write_bytes(encoded(Image.fromarray(values), kind))
    assert decode_image(path, spec)[0, :, 0].tolist() == [0, 0, 1, 128, 255, 255]


def test_16_bit_colour_png(tmp_path: Path) -> None:
    values = landscape().astype(np.uint16) * 256 + 77
    path = tmp_path / "deep.png"
    path.write_bytes(cv2.imencode(".png", values[:, :, ::-1])[1].tobytes())
    np.testing.assert_array_equal(decode_image(path, COLOUR), landscape())


def test_32_bit_pixels_are_refused_with_a_remedy(tmp_path: Path) -> None:
    path = tmp_path / "depth.tiff"
    Image.fromarray(np.ones((4, 4), dtype=np.float32)).save(path)
    with pytest.raises(ImageError, match=r"depth\.tiff has 32-bit pixels.*8 or 16 bits"):
        decode_image(path, COLOUR)


@pytest.mark.parametrize(("mode", "half"), [("RGBA", (200, 100, 50, 128)), ("LA", (200, 128))])
def test_transparency_is_laid_over_black(tmp_path: Path, mode: str, half: tuple[int, ...]) -> None:
    picture = Image.new(mode, (3, 1), half)
    picture.putpixel((0, 0), (*half[:-1], 255))
    picture.putpixel((2, 0), (*half[:-1], 0))
    path = tmp_path / "a.png"
    picture.save(path)

    red = decode_image(path, COLOUR)[0, :, 0]

    assert red[0] == 200
    assert abs(int(red[1]) - 100) <= 1
    assert red[2] == 0


@pytest.mark.parametrize("alpha", [0, 1])
@pytest.mark.parametrize("spec", [GREY, COLOUR])
@pytest.mark.parametrize("kind", ["PNG", "TIFF", "WEBP", "BMP", "palette", "LA", "16 bits"])
def test_an_alpha_of_0_throughout_is_none(tmp_path: Path, kind: str, spec: ImageSpec, alpha: int) -> None:
    """Simulators leave alpha at 0, or cast 1.0 to a byte."""
    picture = landscape()
    transparent = Image.fromarray(np.dstack([picture, np.full(picture.shape[:2], alpha, np.uint8)]))
    path = tmp_path / "a.png"
    if kind == "BMP":
        data = bytearray(encoded(transparent, "BMP"))
    elif kind == "LA":
        picture = np.repeat(picture[:, :, :1], 3, axis=2)
        pale = np.dstack([picture[:, :, 0], np.full(picture.shape[:2], alpha, np.uint8)])
        data = bytearray(encoded(Image.fromarray(pale), "PNG"))
    elif kind == "palette":
        paletted = Image.fromarray(picture).quantize(64)
        picture = np.asarray(paletted.convert("RGB"))
        data = bytearray(encoded(paletted, "PNG", transparency=bytes([alpha]) * 64))
    elif kind == "16 bits":
        deep = np.dstack([picture[:, :, ::-1].astype(np.uint16) * 256, np.full(picture.shape[:2], alpha, np.uint16)])
        data = bytearray(cv2.imencode(".png", deep)[1].tobytes())
    else:
        data = bytearray(encoded(transparent, kind, **({"lossless": True, "exact": True} if kind == "WEBP" else {})))
    path.write_bytes(data)

    pixels = decode_image(path, spec)

    np.testing.assert_array_equal(pixels, convert_image(picture, spec))


def test_a_bmp_of_32_bits_whose_masks_name_an_alpha_that_is_0(tmp_path: Path) -> None:
    picture = landscape()
    pixels = np.dstack([picture[::-1, :, ::-1], np.zeros(picture.shape[:2], np.uint8)]).tobytes()
    masks = struct.pack("<4I", 0xFF0000, 0xFF00, 0xFF, 0xFF000000)
    header = struct.pack("<IiiHHIIiiII", 108, 60, 40, 1, 32, 3, len(pixels), 0, 0, 0, 0) + masks + bytes(52)
    path = tmp_path / "a.bmp"
    path.write_bytes(b"BM" + struct.pack("<IHHI", 122 + len(pixels), 0, 0, 122) + header + pixels)
    np.testing.assert_array_equal(decode_image(path, COLOUR), picture)


def test_one_opaque_pixel_makes_an_alpha(tmp_path: Path) -> None:
    picture = Image.new("RGBA", (2, 1), (200, 100, 50, 0))
    picture.putpixel((0, 0), (200, 100, 50, 255))
    picture.save(tmp_path / "a.png")
    assert decode_image(tmp_path / "a.png", COLOUR).tolist() == [[[200, 100, 50], [0, 0, 0]]]


def test_palette_with_and_without_a_transparent_entry(tmp_path: Path) -> None:
    picture = Image.new("P", (2, 1))
    picture.putpalette([10, 20, 30, 200, 100, 50])
    picture.putpixel((1, 0), 1)
    picture.save(tmp_path / "opaque.png")
    picture.save(tmp_path / "clear.png", transparency=1)
    assert decode_image(tmp_path / "opaque.png", COLOUR).tolist() == [[[10, 20, 30], [200, 100, 50]]]
    assert decode_image(tmp_path / "clear.png", COLOUR).tolist() == [[[10, 20, 30], [0, 0, 0]]]


def test_black_and_white_bitmap(tmp_path: Path) -> None:
    picture = Image.new("1", (2, 1))
    picture.putpixel((1, 0), 1)
    picture.save(tmp_path / "a.png")
    assert decode_image(tmp_path / "a.png", GREY)[0, :, 0].tolist() == [0, 255]


@pytest.mark.parametrize("ending", ["jpg", "tiff", "png"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path: Path, orientation: int, ending: str) -> None:
    """A camera that stores the sensor's rows turned; the upright picture must come back."""
    upright = landscape(64, 96)
    inverse = {5: 5, 6: 8, 7: 7, 8: 6}.get(orientation, orientation)
    turns = {
        2: Image.Transpose.FLIP_LEFT_RIGHT,
        3: Image.Transpose.ROTATE_180,
        4: Image.Transpose.FLIP_TOP_BOTTOM,
        5: Image.Transpose.TRANSPOSE,
        6: Image.Transpose.ROTATE_270,
        7: Image.Transpose.TRANSVERSE,
        8: Image.Transpose.ROTATE_90,
    }
    stored = Image.fromarray(upright)
    if orientation in turns:
        stored = stored.transpose(turns[inverse])
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{ending}"
    stored.save(path, exif=exif, quality=95, subsampling=0)

    assert np.abs(decode_image(path, COLOUR).astype(int) - upright).max() <= 6
    small = decode_image(path, ImageSpec(size=(32, 48)))
    assert np.abs(small.astype(int) - resize_image(upright, (32, 48))).max() <= 6
    assert image_size(path.name, path.read_bytes()) == (64, 96)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "BMP", "TIFF", "WEBP", "PPM"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_truncated_files_are_refused(tmp_path: Path, kind: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (80, 120, 3), dtype=np.uint8)
    data = encoded(Image.fromarray(noise), kind)
    path = tmp_path / "cut.jpg"
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ImageError, match=r"cut\.jpg"):
        decode_image(path, COLOUR)


def test_jpeg_that_lost_only_its_tail_is_refused(tmp_path: Path) -> None:
    """OpenCV would return this picture with a grey lower edge."""
    path = tmp_path / "a.jpg"
    data = encoded(Image.fromarray(landscape(480, 640)), "JPEG")
    path.write_bytes(data[:-200])
    for spec in (COLOUR, GREY, ImageSpec(size=(32, 64))):
        with pytest.raises(ImageError, match=r"a\.jpg is truncated or broken"):
            decode_image(path, spec)


def test_flipped_bytes_in_a_png_are_refused(tmp_path: Path) -> None:
    data = bytearray(encoded(Image.fromarray(landscape()), "PNG"))
    data[len(data) // 2] ^= 0xFF
    path = tmp_path / "a.png"
    path.write_bytes(bytes(data))
    with pytest.raises(ImageError, match=r"a\.png is truncated or broken"):
        decode_image(path, COLOUR)


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"", "is empty"),
        (b"this is no picture\n", "not an image of a known format"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n", "not an image of a known format"),
        (b"\xff\xd8\xff", "truncated or broken"),
        (b"\x89PNG\r\n\x1a\n", "truncated or broken"),
        (b"BM", "truncated or broken"),
        (b"II*\0", "truncated or broken"),
        (b"RIFF\x04\0\0\0WAVE", "truncated or broken"),
        (b"P6", "truncated or broken"),
        (b"\x00" * 4096, "not an image of a known format"),
    ],
)
def test_what_is_no_image_names_the_file(tmp_path: Path, data: bytes, what: str) -> None:
    path = tmp_path / "frame-7.jpg"
    path.write_bytes(data)
    with pytest.raises(ImageError, match=what) as caught:
        decode_image(path, COLOUR)
    assert str(path) in str(caught.value)


@pytest.mark.filterwarnings("ignore::UserWarning:PIL.TiffImagePlugin")
def test_random_damage_gives_a_picture_or_one_error(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = tmp_path / "a.bin"
    for kind in ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "PPM"):
        data = encoded(Image.fromarray(landscape(24, 24)), kind)
        for _ in range(60):
            damaged = bytearray(data)
            for position in rng.integers(0, len(data), 4):
                damaged[position] = rng.integers(0, 256)
            path.write_bytes(bytes(damaged))
            try:
                assert decode_image(path, ImageSpec(size=(8, 8))).shape == (8, 8, 3)
            except ImageError as error:
                assert str(path) in str(error)


@pytest.mark.parametrize("side", [8193, 10_000, 40_000])
def test_decompression_bomb_is_refused_from_its_header(tmp_path: Path, side: int) -> None:
    path = tmp_path / "bomb.png"
    path.write_bytes(hollow_png(side, 8192))
    with pytest.raises(ImageError, match=rf"bomb\.png has 8192×{side} pixels, more than the limit of 67108864"):
        decode_image(path, ImageSpec(size=(32, 64)))


def test_too_large_a_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse.png"
    with path.open("wb") as file:
        file.truncate(images.MAX_FILE_BYTES + 1)
    with pytest.raises(ImageError, match=r"sparse\.png has 536870913 bytes, more than the limit"):
        decode_image(path, COLOUR)


def test_missing_file_directory_and_pipe_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match=r"cannot read .*gone\.png: No such file"):
        decode_image(tmp_path / "gone.png", COLOUR)
    with pytest.raises(ImageError, match="not a regular file"):
        decode_image(tmp_path, COLOUR)
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(ImageError, match="not a regular file"):
        decode_image(tmp_path / "pipe.png", COLOUR)


def test_name_that_is_not_utf8_is_read_and_named(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.png"))
    Image.fromarray(landscape()).save(tmp_path / "plain.png")
    (tmp_path / "plain.png").rename(path)
    np.testing.assert_array_equal(decode_image(path, COLOUR), landscape())
    path.write_bytes(b"no")
    with pytest.raises(ImageError) as caught:
        decode_image(path, COLOUR)
    assert r"caf\xe9.png" in str(caught.value)
    assert str(caught.value).isprintable()


def test_shrinking_averages_and_enlarging_is_bilinear() -> None:
    checkers = (np.indices((8, 8)).sum(axis=0) % 2 * 200).astype(np.uint8)[:, :, None]
    assert np.unique(resize_image(checkers, (4, 4))).tolist() == [100]
    edge = np.array([[[0], [200]]], dtype=np.uint8)
    assert resize_image(edge, (1, 4))[0, :, 0].tolist() == [0, 50, 150, 200]
    # One side shrinks, the other grows: still averaged along the first.
    assert np.unique(resize_image(checkers, (4, 16))[:, 2:-2]).tolist() == [100]


def test_resizing_to_the_same_size_changes_nothing() -> None:
    picture = landscape()
    assert resize_image(picture, (40, 60)) is picture


@pytest.mark.parametrize("size", [(0, 64), (32, -1), (100_000, 100_000)])
def test_impossible_sizes_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(ConfigError, match="image size"):
        ImageSpec(size=size)


def test_channels() -> None:
    assert GREY.channels == 1
    assert COLOUR.channels == 3


@pytest.fixture
def thirty(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{i}.png" for i in range(30)]
    for i, path in enumerate(paths):
        Image.new("L", (4, 4), i).save(path)
    return paths


@pytest.mark.parametrize("threads", [None, 1, 3])
def test_many_images_come_in_order(thirty: list[Path], threads: int | None) -> None:
    values = [int(pixels[0, 0, 0]) for pixels in decode_images(thirty, GREY, threads=threads)]
    assert values == list(range(30))


def test_look_ahead_is_bounded_and_threads_end(thirty: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[Path] = []
    decode = images.decode_image

    def spy(path: Path, spec: ImageSpec) -> NDArray[np.uint8]:
        started.append(path)
        return decode(path, spec)

    monkeypatch.setattr(images, "decode_image", spy)
    reader = iter(decode_images(thirty, GREY, threads=2))
    next(reader)
    assert len(started) <= 5
    reader.close()  # type: ignore[attr-defined]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ahead")]


def test_a_bad_image_stops_the_reader_at_its_place(thirty: list[Path]) -> None:
    thirty[17].write_bytes(b"broken")
    seen = []
    with pytest.raises(ImageError, match=readable(thirty[17])):
        for pixels in decode_images(thirty, GREY, threads=2):
            seen.append(int(pixels[0, 0, 0]))
    assert seen == list(range(17))


def test_broken_images_print_nothing(tmp_path: Path) -> None:
    """libjpeg and libpng write to file descriptor 2 by themselves when they are let."""
    jpeg = bytearray(encoded(Image.fromarray(landscape(200, 300)), "JPEG"))
    jpeg[len(jpeg) // 2 : len(jpeg) // 2 + 30] = b"\x55" * 30
    (tmp_path / "a.jpg").write_bytes(bytes(jpeg))
    (tmp_path / "b.png").write_bytes(encoded(Image.fromarray(landscape()), "PNG")[:-40])
    (tmp_path / "c.png").write_bytes(hollow_png(12_000, 12_000))
    code = (
        "import sys; from pathlib import Path\n"
        "from everplace.images.decoding import *; from everplace.errors import ImageError\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try: decode_image(path, ImageSpec(size=(8, 8)))\n"
        "    except ImageError: pass\n"
        "print('done')"
    )
    done = subprocess.run([sys.executable, "-W", "always", "-c", code, str(tmp_path)], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("done\n", "")


@pytest.mark.parametrize("spec", [COLOUR, GREY, ImageSpec((13, 90)), ImageSpec((80, 20), grey=True)])
@pytest.mark.parametrize("channels", [1, 3])
def test_an_image_in_memory_becomes_what_its_file_is_decoded_to(tmp_path: Path, spec: ImageSpec, channels: int) -> None:
    image = landscape(channels=channels)
    before = image.copy()
    Image.fromarray(image.squeeze()).save(tmp_path / "a.png")
    wanted = decode_image(tmp_path / "a.png", spec)
    for form in (image, image.squeeze(), np.asfortranarray(image)):
        converted = convert_image(form, spec)
        np.testing.assert_array_equal(converted, wanted)
        assert converted.flags.writeable
        converted[:] = 0
    np.testing.assert_array_equal(image, before)
