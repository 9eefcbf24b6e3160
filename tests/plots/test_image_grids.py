from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from numpy.typing import NDArray

from everplace.errors import ImageError
from everplace.plots.canvas import new_figure, png_bytes
from everplace.plots.image_grids import (
    Translation,
    draw_constant_grid,
    draw_image_grid,
    draw_swap_grid,
    draw_translations,
)  # fmt: skip

ONE: Any = {"place_labels": ["p"], "condition_labels": ["c"], "title": "t"}


def _grey(value: int, shape: tuple[int, ...] = (4, 8, 1)) -> NDArray[Any]:
    return np.full(shape, value, np.uint8)


def _values(axes: Axes) -> list[int]:
    return [int(np.asarray(image.get_array())[0, 0, 0]) for image in axes.images]


def _by_place(axes: Axes) -> list[list[int]]:
    """The grey values as a reader sees them: by rows from the top, each from the left."""
    rows: dict[float, list[tuple[float, int]]] = {}
    for image, value in zip(axes.images, _values(axes), strict=True):
        left, _, _, top = image.get_extent()
        rows.setdefault(round(top, 4), []).append((left, value))
    return [[value for _, value in sorted(rows[top])] for top in sorted(rows)]


def test_grid_places_images_and_labels() -> None:
    figure = new_figure(5)
    axes = draw_image_grid(
        figure,
        [[_grey(1), _grey(2), None], [_grey(4), _grey(5), _grey(6)]],
        row_labels=["up", "down"],
        column_labels=["a", "b", "c"],
        title="Grid",
    )
    assert _by_place(axes) == [[1, 2], [4, 5, 6]]
    assert {"up", "down", "a", "b", "c", "Grid"} == {text.get_text() for text in axes.texts}
    # The label stands beside its own row.
    places = {text.get_text(): text.get_position() for text in axes.texts}
    _, _, bottom, top = axes.images[2].get_extent()
    assert top < places["down"][1] < bottom
    assert png_bytes(figure, 50)


def test_swap_grid_has_originals_as_header_row_and_column() -> None:
    figure = new_figure(6)
    swapped = [[_grey(10 * a + b) for b in (1, 2, 3)] for a in (1, 2)]
    axes = draw_swap_grid(
        figure,
        swapped,
        [_grey(101), _grey(102)],
        [_grey(201), _grey(202), _grey(203)],
        place_labels=["summer 1", "winter 1"],
        condition_labels=["x", "y", "z"],
        title="Swap",
    )
    assert _by_place(axes) == [[201, 202, 203], [101, 11, 12, 13], [102, 21, 22, 23]]
    words = [text.get_text() for text in axes.texts]
    assert any("z_p" in word and "z_c" in word for word in words)
    assert {"summer 1", "winter 1", "x", "y", "z"} <= set(words)
    # The headers are set apart by a wider gap than the one inside.
    row = sorted(
        (image.get_extent() for image in axes.images if image.get_extent()[3] > 0.9),
        key=lambda e: (e[3], e[0]),
    )
    assert row[1][0] - row[0][1] > row[2][0] - row[1][1] > 0
    assert png_bytes(figure, 50)


def test_swap_grid_of_one_image() -> None:
    figure = new_figure(3)
    axes = draw_swap_grid(figure, [[_grey(128, (6, 4, 3))]], [_grey(1, (6, 4, 3))], [_grey(2, (6, 4, 1))], **ONE)
    assert _by_place(axes) == [[2], [1, 128]]
    assert png_bytes(figure, 50)


def test_constant_grid_puts_each_image_below_its_original_and_wraps() -> None:
    figure = new_figure(6)
    axes = draw_constant_grid(
        figure,
        [_grey(n) for n in range(5)],
        [_grey(100 + n) for n in range(5)],
        labels=list("abcde"),
        columns=3,
        title="Constant",
    )
    assert _by_place(axes) == [[0, 1, 2], [100, 101, 102], [3, 4], [103, 104]]
    extents = dict(zip(_values(axes), (image.get_extent() for image in axes.images), strict=True))
    for number in range(5):
        assert extents[number][:2] == extents[100 + number][:2]
        assert extents[number][2] < extents[100 + number][3]
    words = [text.get_text() for text in axes.texts]
    assert words.count("original") == words.count("constant z_c") == 2
    assert set("abcde") <= set(words)
    _, height = figure.get_size_inches()
    assert max(extent[2] for extent in extents.values()) < height
    assert png_bytes(figure, 50)


def test_constant_grid_of_one() -> None:
    axes = draw_constant_grid(new_figure(3), [_grey(1)], [_grey(2)], labels=["a"], columns=1, title="t")
    assert _by_place(axes) == [[1], [2]]


def test_translations_stand_above_the_true_frames_of_their_condition() -> None:
    figure = new_figure(6)
    strips = [
        Translation(_grey(n), [_grey(n + 1), _grey(n + 2)], [_grey(n + 3), _grey(n + 4)], f"summer {n}")
        for n in (10, 20)
    ]
    axes = draw_translations(figure, strips, conditions=["summer", "$winter$"], title="Strip")
    assert _by_place(axes) == [[10, 11, 12], [13, 14], [20, 21, 22], [23, 24]]
    extents = dict(zip(_values(axes), (image.get_extent() for image in axes.images), strict=True))
    for translated, true in ((11, 13), (12, 14), (21, 23), (22, 24)):
        assert extents[translated][:2] == extents[true][:2]
        assert extents[translated][2] < extents[true][3]
    words = [text.get_text() for text in axes.texts]
    assert {"Strip", "summer 10", "summer 20"} <= set(words)
    assert [words.count(word) for word in ("decoded", "true", "summer", "$winter$")] == [2, 2, 2, 2]
    # A row's word stands between the frame and the images that it names.
    left = next(text for text in axes.texts if text.get_text() == "decoded").get_position()[0]
    assert extents[10][1] < left < extents[11][0]
    width, height = figure.get_size_inches()
    assert max(extent[1] for extent in extents.values()) <= width
    assert max(extent[2] for extent in extents.values()) <= height
    assert png_bytes(figure, 50)


def test_a_grid_without_an_image_is_refused() -> None:
    with pytest.raises(ImageError, match="at least one image"):
        draw_image_grid(new_figure(), [[None]], row_labels=["a"], column_labels=["b"], title="t")
