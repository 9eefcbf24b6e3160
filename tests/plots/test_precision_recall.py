from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from everplace.plots.canvas import new_figure, png_bytes
from everplace.plots.precision_recall import (
    Curve,
    draw_precision_recall_panels,
    from_recall_zero,
)
from everplace.plots.style import COLOURS

Make = Callable[[list[float], list[float]], Curve]


def test_line_holds_the_curve_from_recall_zero(make_curve: Make) -> None:
    curve = make_curve([0.2, 0.5, 0.5, 0.8], [1.0, 0.9, 0.7, 0.6])
    (axes,) = draw_precision_recall_panels(new_figure(), {("winter", "summer"): {"hog": curve}}, columns=2)
    (line,) = axes.lines
    np.testing.assert_allclose(np.asarray(line.get_xdata()), [0.0, 0.2, 0.5, 0.5, 0.8])
    np.testing.assert_allclose(np.asarray(line.get_ydata()), [1.0, 1.0, 0.9, 0.7, 0.6])
    assert line.get_markevery() == [4]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("recall", "precision")
    assert axes.get_title() == "winter → summer"
    assert (axes.get_xlim()[0], axes.get_ylim()[0]) == (0, 0)


def test_area_drawn_is_the_area_reported(make_curve: Make) -> None:
    curve = make_curve([0.25, 0.75], [1.0, 0.5])
    x = from_recall_zero(curve.recall, recall=True)
    y = from_recall_zero(curve.precision)
    area = float(np.sum(np.diff(x) * (y[1:] + y[:-1]) / 2))
    # The rectangle 0.25 * 1 and the trapezoid 0.5 * 0.75, by hand.
    assert area == pytest.approx(0.625)


def test_any_name_stands_in_the_legend_in_its_colour(make_curve: Make) -> None:
    figure = new_figure()
    curves = {"_run $1$": make_curve([0.5], [1.0]), "sad": make_curve([0.1, 0.4], [0.5, 0.2])}
    (axes,) = draw_precision_recall_panels(figure, {("a", "b"): curves}, columns=2)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["_run $1$", "sad"]
    assert [to_hex(str(line.get_color())).upper() for line in axes.lines] == list(COLOURS[:2])
    assert png_bytes(figure, 50)


def test_one_panel_for_every_ordered_pair(make_curve: Make) -> None:
    conditions = ["spring", "summer", "fall", "winter"]
    figure = new_figure(9)
    panels = {
        pair: {"hog": make_curve([0.5], [1.0]), "sad": make_curve([0.2], [0.7])} for pair in permutations(conditions, 2)
    }
    axes = draw_precision_recall_panels(figure, panels, columns=3)
    assert [panel.get_title() for panel in axes] == [f"{query} → {database}" for query, database in panels]
    assert all(len(panel.lines) == 2 for panel in axes)
    columns = {round(panel.get_position().x0, 3) for panel in axes}
    assert len(columns) == 3
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["hog", "sad"]
    assert png_bytes(figure, 30)


def test_a_method_keeps_its_colour_where_others_are_missing(make_curve: Make) -> None:
    figure = new_figure()
    curve = make_curve([0.5], [1.0])
    first, second = draw_precision_recall_panels(
        figure, {("a", "b"): {"hog": curve, "sad": curve}, ("b", "a"): {"sad": curve}}, columns=2
    )
    assert first.lines[1].get_color() == second.lines[0].get_color() != first.lines[0].get_color()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_empty_places_of_the_panel_grid_are_removed(make_curve: Make, count: int) -> None:
    figure = new_figure()
    panels: dict[tuple[str, str], dict[str, Any]] = {
        (f"q{number}", "db"): {"hog": make_curve([0.5], [1.0])} for number in range(count)
    }
    axes = draw_precision_recall_panels(figure, panels, columns=3)
    assert len(figure.axes) == len(axes) == count
    # The lowest panel of each column names its axis.
    assert [panel.get_xlabel() for panel in axes] == [""] * max(0, count - 3) + ["recall"] * min(3, count)
    assert png_bytes(figure, 30)


@pytest.mark.parametrize(("names", "columns"), [(1, 1), (3, 3), (5, 3), (9, 3)])
def test_the_legend_of_all_panels_has_lines_of_about_one_length(make_curve: Make, names: int, columns: int) -> None:
    curves = {f"cp-vae-number-{name} (recipe best)": make_curve([0.5], [1.0]) for name in range(names)}
    figure = new_figure(8)
    draw_precision_recall_panels(figure, {("day", "night"): curves, ("night", "day"): curves}, columns=2)
    assert png_bytes(figure, figure.dpi)
    (legend,) = figure.legends
    across = {round(text.get_window_extent().x0) for text in legend.get_texts()}
    assert len(across) == columns
    assert legend.get_window_extent().x0 >= 0
    assert legend.get_window_extent().x1 <= figure.bbox.x1
