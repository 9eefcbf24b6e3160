"""The path that joins two drives, drawn into their similarity."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from everplace.plots.similarity_matrix import draw_similarity
from everplace.plots.style import WRONG, mark_legend, styled

__all__ = ["draw_path"]

_PATH = "white"


@styled()
def draw_path(
    axes: Axes,
    S: NDArray[Any],
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]],
    unsure: NDArray[np.bool_],
    strides: tuple[int, int],
    *,
    first: str,
    second: str,
    title: str,
) -> None:
    """Draws the similarity of two drives and the path through it.

    Args:
        axes: Where to draw.
        S: M×N scores of every `strides[0]`-th frame of the first drive and every `strides[1]`-th of the second.
        pairs: The path: K indices of frames of the first drive, and K of the second.
        unsure: K, the pairs to mark.
        strides: See `S`.
        first: Name of the first drive, the rows.
        second: Name of the second drive, the columns.
        title: Written above.
    """
    draw_similarity(axes, S, query=first, database=second, title=title)
    rows, columns = pairs[0] / strides[0], pairs[1] / strides[1]
    axes.plot(columns, rows, color=_PATH, linewidth=1.2, linestyle=":")
    marks = {"found path": Line2D([], [], color=_PATH, linewidth=1.4, linestyle=":")}
    if unsure.any():
        look: dict[str, Any] = {"marker": ".", "linestyle": "none", "color": WRONG, "markersize": 3.0}
        axes.plot(columns[unsure], rows[unsure], **look)
        marks["unsure"] = Line2D([], [], **{**look, "markersize": 6.0})
    # Frames are counted as the drives count them.
    for axis, stride in ((axes.yaxis, strides[0]), (axes.xaxis, strides[1])):
        axis.set_major_formatter(FuncFormatter(lambda value, _, stride=stride: f"{value * stride:g}"))
    mark_legend(axes, marks)
