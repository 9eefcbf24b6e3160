"""16-bit frames become 8-bit ones by one scale for a drive, wherever they come from."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from tests.importing.packing import pack
from tests.importing.sources.test_bag import IMAGE, write_bag

from everplace.errors import ConfigError, ImageError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing.import_route import ImportSummary, import_route
from everplace.route.inspection import inspect_route
from everplace.route.route import open_route

LOW, HIGH = 1700, 3748
VALUES = np.linspace(LOW, HIGH - 1, 64 * 48).round().astype(np.uint16).reshape(48, 64)
COLOURS = np.dstack([VALUES, VALUES[::-1], VALUES[:, ::-1]])


def wanted(values: NDArray[np.uint16]) -> NDArray[np.int64]:
    return (values.astype(np.int64) - LOW) * 256 // (HIGH - LOW)


def encoded(values: NDArray[np.uint16], ending: str) -> bytes:
    if values.ndim == 3:
        return cv2.imencode(ending, values[:, :, ::-1])[1].tobytes()
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, {".png": "PNG", ".tiff": "TIFF", ".pgm": "PPM"}[ending])
    return buffer.getvalue()


def first_frame(route: Path) -> NDArray[np.uint8]:
    traverse = open_route(route).traverses[0]
    assert traverse.paths[0].suffix == ".png"
    assert not traverse.paths[0].is_symlink()
    return decode_image(traverse.paths[0], ImageSpec())


@pytest.mark.parametrize(
    ("ending", "values"), [(".png", VALUES), (".tiff", VALUES), (".pgm", VALUES), (".png", COLOURS), (".tiff", COLOURS)]
)
def test_image_files_are_scaled_and_written(tmp_path: Path, ending: str, values: NDArray[np.uint16]) -> None:
    (tmp_path / "drives/day").mkdir(parents=True)
    (tmp_path / f"drives/day/a{ending}").write_bytes(encoded(values, ending))
    summary = import_route("images", tmp_path / "drives", tmp_path / "out", {"range": f"{LOW}:{HIGH}"})
    assert summary.linked == 0
    assert not [note for note in summary.notes if "16-bit" in note]
    pixels = first_frame(tmp_path / "out")
    expected = wanted(values)
    np.testing.assert_array_equal(pixels, expected if values.ndim == 3 else np.dstack([expected] * 3))
    assert len(np.unique(pixels)) > 200


def test_the_orientation_is_applied(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(VALUES).save(tmp_path / "day/a.png", exif=exif)
    import_route("images", tmp_path / "day", tmp_path / "out", {"range": f"{LOW}:{HIGH}"})
    np.testing.assert_array_equal(first_frame(tmp_path / "out")[:, :, 0], np.rot90(wanted(VALUES), -1))


@pytest.mark.parametrize(
    ("encoding", "values"), [("mono16", VALUES), ("rgb16", COLOURS), ("bgr16", COLOURS[:, :, ::-1])]
)
def test_bags_are_scaled(tmp_path: Path, encoding: str, values: NDArray[np.uint16]) -> None:
    write_bag(tmp_path / "day.bag", [("/camera", IMAGE, 1.0, (encoding, np.ascontiguousarray(values)))])
    import_route("bag", tmp_path / "day.bag", tmp_path / "out", {"range": f"{LOW}:{HIGH}"})
    expected = wanted(COLOURS if values.ndim == 3 else VALUES)
    np.testing.assert_array_equal(first_frame(tmp_path / "out"), np.atleast_3d(expected) * np.ones(3, np.int64))


def test_a_mosaic_in_a_bag_is_scaled(tmp_path: Path) -> None:
    values = np.full((8, 8), (LOW + HIGH) // 2, dtype=np.uint16)
    write_bag(tmp_path / "day.bag", [("/camera", IMAGE, 1.0, ("bayer_rggb16", values))])
    import_route("bag", tmp_path / "day.bag", tmp_path / "out", {"range": f"{LOW}:{HIGH}"})
    assert np.unique(first_frame(tmp_path / "out")).tolist() == [128]


def tum(root: Path) -> Path:
    (root / "seq/rgb").mkdir(parents=True)
    (root / "seq/rgb/1.0.png").write_bytes(encoded(VALUES, ".png"))
    (root / "seq/rgb.txt").write_text("1.0 rgb/1.0.png\n")
    return root


def euroc(root: Path) -> Path:
    (root / "seq/mav0/cam0/data").mkdir(parents=True)
    (root / "seq/mav0/cam0/data/100.png").write_bytes(encoded(VALUES, ".png"))
    (root / "seq/mav0/cam0/data.csv").write_text("#timestamp,filename\n100,100.png\n")
    return root


def kitti(root: Path) -> Path:
    (root / "sequences/00/image_0").mkdir(parents=True)
    (root / "sequences/00/image_0/000000.png").write_bytes(encoded(VALUES, ".png"))
    return root


@pytest.mark.parametrize("archived", [False, True])
@pytest.mark.parametrize("write", [tum, euroc, kitti])
def test_data_sets_and_archives_are_scaled(tmp_path: Path, write: Callable[[Path], Path], archived: bool) -> None:
    source = write(tmp_path / "data")
    if archived:
        source = pack(source, tmp_path / "data.tar.gz")
    summary = import_route(write.__name__, source, tmp_path / "plain")
    assert [note for note in summary.notes if "1 of 1 16-bit frames of" in note and "`range=17" in note]
    import_route(write.__name__, source, tmp_path / "out", {"range": f"{LOW}:{HIGH}"})
    np.testing.assert_array_equal(first_frame(tmp_path / "out")[:, :, 0], wanted(VALUES))


@pytest.mark.parametrize("options", [{"size": "64x48"}, {"change": "0.99"}, {"every_frames": "2"}])
def test_what_samples_and_resizes_sees_the_scaled_values(tmp_path: Path, options: dict[str, str]) -> None:
    (tmp_path / "day").mkdir()
    for number, values in enumerate((VALUES, VALUES[::-1], VALUES[:, ::-1])):
        (tmp_path / f"day/{number}.png").write_bytes(encoded(values, ".png"))

    def told(out: str, **more: str) -> ImportSummary:
        return import_route("images", tmp_path / "day", tmp_path / out, options | more)

    frames = {"size": 3, "change": 3, "every_frames": 2}[next(iter(options))]
    (note,) = (note for note in told("plain").notes if "16-bit" in note)
    assert f"{frames} of {frames} 16-bit frames of day use less than a sixteenth" in note
    told("scaled", range=f"{LOW}:{HIGH}")
    np.testing.assert_array_equal(first_frame(tmp_path / "scaled")[:, :, 0], wanted(VALUES))


def test_files_that_stay_are_linked_and_a_broken_one_is_no_error_before_it_has_to_be_decoded(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    Image.fromarray((VALUES >> 4).astype(np.uint8)).save(tmp_path / "day/0.png")
    (tmp_path / "day/1.png").write_bytes(encoded(VALUES, ".png")[:-40])
    assert import_route("images", tmp_path / "day", tmp_path / "out").linked == 2
    with pytest.raises(ImageError, match=r"1\.png is truncated or broken"):
        import_route("images", tmp_path / "day", tmp_path / "scaled", {"bits": "12"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"range": "5"}, "`range`=5 cannot be: it is not A:B"),
        ({"range": "9:9"}, "it is not A:B"),
        ({"range": "0:70000"}, "it is not A:B"),
        ({"bits": "17"}, "`bits`=17 cannot be"),
        ({"bits": "12", "range": "0:5"}, "range and bits exclude each other"),
    ],
)
def test_a_scale_that_cannot_be_is_refused(tmp_path: Path, options: dict[str, str], message: str) -> None:
    (tmp_path / "day").mkdir()
    with pytest.raises(ConfigError, match=message):
        import_route("images", tmp_path / "day", tmp_path / "out", options)


def test_transparent_16_bit_colours_are_what_they_were_where_no_scale_is_given(tmp_path: Path) -> None:
    alpha = np.full(VALUES.shape, 40000, dtype=np.uint16)
    pixels = np.dstack([COLOURS[:, :, ::-1] * 16, alpha])
    (tmp_path / "day").mkdir()
    (tmp_path / "day/0.png").write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    import_route("images", tmp_path / "day", tmp_path / "out", {"size": "64x48"})
    np.testing.assert_array_equal(
        first_frame(tmp_path / "out"), decode_image(tmp_path / "day/0.png", ImageSpec(size=(48, 64)))
    )


def test_data_inspect_counts_them_too(tmp_path: Path) -> None:
    for drive in ("day", "night"):
        (tmp_path / drive).mkdir()
        for number in range(3):
            values = VALUES if drive == "day" or number == 1 else VALUES * 16
            (tmp_path / drive / f"{number}.png").write_bytes(encoded(values, ".png"))
    with pytest.warns(UserWarning, match="16-bit frames") as caught:
        inspect_route(open_route(tmp_path))
    said = [str(warning.message) for warning in caught if "16-bit" in str(warning.message)]
    assert [text[: text.index(" use")] for text in said] == [
        "3 of 3 16-bit frames of day", "1 of 3 16-bit frames of night",
    ]  # fmt: skip
