from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from everplace.errors import ImageError
from everplace.experiments.contact_sheet import contact_sheet
from everplace.plots.canvas import save_figure
from everplace.route.route import open_route


def texts(route: Path, places: tuple[str, ...] = (), count: int = 8) -> list[str]:
    (axes,) = contact_sheet(open_route(route), places, count=count).axes
    return [text.get_text() for text in axes.texts]


def pictures(route: Path, places: tuple[str, ...] = (), count: int = 8) -> list[NDArray[Any]]:
    (axes,) = contact_sheet(open_route(route), places, count=count).axes
    return [np.asarray(image.get_array()) for image in axes.images]


def stored(path: Path) -> NDArray[Any]:
    return np.asarray(Image.open(path))


def test_a_row_is_a_place_and_a_column_a_traverse(tiny_route: Path) -> None:
    drawn = pictures(tiny_route, count=3)
    expected = [stored(tiny_route / name / f"{place}.png") for place in (0, 6, 11) for name in ("summer", "winter")]
    assert len(drawn) == len(expected)
    assert all(np.array_equal(one, other) for one, other in zip(drawn, expected, strict=True))
    assert texts(tiny_route, count=3) == ["tiny: 3 of 12 places", "summer", "winter", "0", "6", "11"]


def test_only_the_places_given_take_part(tiny_route: Path) -> None:
    assert texts(tiny_route, ("4", "9"))[-2:] == ["4", "9"]


def test_the_condition_is_named_where_it_is_another(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text('[traverses.winter]\ncondition = "snow"\n')
    assert "winter (snow)" in texts(tiny_route)


def test_an_unreadable_frame_leaves_its_cell_empty(tiny_route: Path) -> None:
    (tiny_route / "winter" / "0.png").write_bytes(b"")
    assert len(pictures(tiny_route, count=3)) == 5
    for path in tiny_route.glob("*/*.png"):
        path.write_bytes(b"")
    with pytest.raises(ImageError, match="at least one image"):
        contact_sheet(open_route(tiny_route))


def test_traverses_that_are_not_aligned(tiny_route: Path) -> None:
    for path in (tiny_route / "winter").iterdir():
        path.rename(path.with_name(f"w{path.name}"))
    (tiny_route / "winter" / "w11.png").unlink()
    shown = texts(tiny_route, count=3)
    assert shown[0] == "tiny: not aligned, so the frames of a row are not the same place"
    assert shown[3:] == ["0 %", "33 %", "67 %"]
    expected = [
        stored(tiny_route / name) for name in ("summer/0.png", "winter/w0.png", "summer/4.png", "winter/w3.png")
    ]
    drawn = pictures(tiny_route, count=3)
    assert all(np.array_equal(one, other) for one, other in zip(drawn, expected, strict=False))


def test_large_frames_are_shrunk_and_the_sheet_is_a_png(tiny_route: Path, tmp_path: Path) -> None:
    Image.new("RGB", (2000, 1000), (200, 0, 0)).save(tiny_route / "summer" / "0.png")
    assert pictures(tiny_route, count=1)[0].shape == (240, 480, 3)
    save_figure(contact_sheet(open_route(tiny_route)), tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.format == "PNG"
        assert sheet.width > 1000
