"""Precision-recall curves: one panel for every ordered pair of conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from everplace.plots.style import LineLook, line_looks, polish, set_legend, styled, write_plainly

__all__ = ["Curve", "draw_precision_recall_panels", "from_recall_zero"]


class Curve(Protocol):
    """A precision-recall curve: one point a distinct score, in the order of falling threshold."""

    @property
    def recall(self) -> NDArray[Any]:
        """K recalls in [0, 1], never falling."""
        ...

    @property
    def precision(self) -> NDArray[Any]:
        """K precisions in [0, 1]."""
        ...

    @property
    def threshold(self) -> NDArray[Any]:
        """K scores: a proposal counts when its score is at least this high."""
        ...


def from_recall_zero(values: NDArray[Any], *, recall: bool = False) -> NDArray[np.float64]:
    """Puts the point at recall 0 in front, so that the area drawn is the area reported.

    `auc_pr` counts the rectangle from recall 0 to the curve's first point (docs, "Scores").

    Args:
        values: The K recalls, precisions or thresholds of a curve.
        recall: Whether they are the recalls, which get a 0 in front; the others repeat their first value.

    Returns:
        K + 1 values.
    """
    array = np.asarray(values, dtype=np.float64)
    front = np.zeros_like(array[:1]) if recall else array[:1]
    return np.concatenate([front, array])


@styled()
def draw_precision_recall_panels(
    figure: Figure, panels: Mapping[tuple[str, str], Mapping[str, Curve]], *, columns: int
) -> list[Axes]:
    """Draws one panel for every ordered pair of conditions (the paper's Figures 10 and 11).

    A method has the same colour in every panel; one legend below explains them all. A dot marks where a curve ends,
    which is recall@1 at most. The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        panels: The curves of each (query condition, database condition).
        columns: Panels in a row, at most.

    Returns:
        One axes a panel, in order.
    """
    columns = min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    looks = line_looks(label for curves in panels.values() for label in curves)
    width = float(figure.get_figwidth())
    # A panel is about as high as wide; the legend takes a line for every few names.
    entries = _balanced(list(looks), width)
    lines_below = math.ceil(len(looks) / entries)
    figure.set_size_inches(width, rows * (width / max(columns, 2)) * 0.9 + 0.22 * lines_below + 0.15)
    every: list[Axes] = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for axes in every[len(panels) :]:
        axes.remove()
    drawn = every[: len(panels)]
    handles: dict[str, Line2D] = {}
    for place, (axes, ((query, database), curves)) in enumerate(zip(drawn, panels.items(), strict=True)):
        handles = _draw_panel(axes, curves, looks) | handles
        write_plainly(axes.set_title(f"{query} → {database}", fontsize=10.0))
        # The axes are shared: only the panels at the left and at the bottom carry words and numbers.
        lowest = place + columns >= len(panels)
        axes.set_xlabel("recall" if lowest else "")
        axes.set_ylabel("precision" if place % columns == 0 else "")
        axes.tick_params(labelbottom=lowest, labelleft=place % columns == 0)
    ordered = [label for label in looks if label in handles]
    set_legend(figure, [handles[label] for label in ordered], ordered, loc="outside lower center", ncols=entries)
    return drawn


def _draw_panel(axes: Axes, curves: Mapping[str, Curve], looks: Mapping[str, LineLook]) -> dict[str, Line2D]:
    """Draws the curves of all methods; gives the line of each."""
    lines: dict[str, Line2D] = {}
    for label, curve in curves.items():
        recall, look = from_recall_zero(curve.recall, recall=True), looks[label]
        (lines[label],) = axes.plot(
            recall, from_recall_zero(curve.precision), color=look.colour, linestyle=look.dashes, linewidth=1.6,
            marker="o", markersize=4.0, markevery=[len(recall) - 1],
        )  # fmt: skip
    polish(axes)
    axes.set_xlim(0.0, 1.01)
    axes.set_ylim(0.0, 1.03)
    return lines


def _balanced(labels: Sequence[str], width: float) -> int:
    """How many entries stand beside each other in a legend of `width` inches, so that its lines are about equal."""
    longest = max(map(len, labels))
    most = max(1, int(width / (0.6 * longest * 8.0 / 72.0 + 0.6)))  # a line and a gap beside each text
    return max(1, math.ceil(len(labels) / max(1, math.ceil(len(labels) / most))))
