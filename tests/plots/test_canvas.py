from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from everplace.errors import ConfigError, StorageError
from everplace.plots.canvas import (
    Cell,
    inch_axes,
    new_axes,
    new_figure,
    place_image,
    png_bytes,
    save_figure,
    svg_bytes,
)


def test_grey_becomes_three_equal_channels() -> None:
    grey = np.arange(6, dtype=np.uint8).reshape(2, 3, 1)
    shown = np.asarray(place_image(inch_axes(new_figure(4), 3), grey, Cell(1, 1, 2, 1)).get_array())
    np.testing.assert_array_equal(shown, np.repeat(grey, 3, axis=2))


def test_image_is_placed_undistorted_and_centred() -> None:
    axes = inch_axes(new_figure(4), 3)
    wide = place_image(axes, np.zeros((10, 40, 1), np.uint8), Cell(1, 1, 2, 1))
    assert wide.get_extent() == pytest.approx([1, 3, 1.75, 1.25])
    tall = place_image(axes, np.zeros((40, 10, 1), np.uint8), Cell(1, 1, 2, 1))
    assert tall.get_extent() == pytest.approx([1.875, 2.125, 2, 1])
    assert axes.get_xlim() == (0, 4)
    assert axes.get_ylim() == (3, 0)


def test_an_inch_on_the_axes_is_an_inch_of_the_picture() -> None:
    figure = new_figure(4)
    axes = inch_axes(figure, 2)
    place_image(axes, np.zeros((1, 1, 1), np.uint8), Cell(1, 0.5, 1, 1))
    with PillowImage.open(io.BytesIO(png_bytes(figure, 100))) as picture:
        pixels = np.asarray(picture.convert("L"))
    assert pixels.shape == (200, 400)
    rows, columns = np.nonzero(pixels < 128)
    assert (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1) == (50, 150, 100, 200)


def test_the_same_figure_gives_the_same_bytes() -> None:
    def draw() -> tuple[bytes, bytes]:
        figure, axes = new_axes(3, 2)
        axes.plot([0, 1], [1, 0])
        return png_bytes(figure), svg_bytes(figure)

    assert draw() == draw()


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("b.SVG", b"<?xml"), ("c.pdf", b"%PDF")])
def test_files_have_the_format_of_their_suffix(tmp_path: Path, name: str, start: bytes) -> None:
    figure, _ = new_axes(2, 2)
    save_figure(figure, tmp_path / "new" / name)
    assert (tmp_path / "new" / name).read_bytes().startswith(start)
    assert [path.name for path in (tmp_path / "new").iterdir()] == [name]


def test_unknown_suffix_names_the_file_and_the_remedy(tmp_path: Path) -> None:
    figure, _ = new_axes(2, 2)
    with pytest.raises(ConfigError, match=r"x\.bmp.*\.png"):
        save_figure(figure, tmp_path / "x.bmp")
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    figure, _ = new_axes(2, 2)
    with pytest.raises(StorageError, match=r"x\.png"):
        save_figure(figure, tmp_path / "file" / "x.png")


def test_no_room_module_imports_pyplot() -> None:
    code = (
        "import sys, importlib, pkgutil, everplace.plots\n"
        "for module in pkgutil.iter_modules(everplace.plots.__path__):\n"
        "    importlib.import_module('everplace.plots.' + module.name)\n"
        "from everplace.plots.canvas import new_axes, png_bytes\n"
        "png_bytes(new_axes()[0])\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
