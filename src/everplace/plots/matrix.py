"""The similarity matrix, with its truth outlined and every query's best match marked right or wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from everplace.errors import DescriptorsError
from everplace.plots.style import SEQUENTIAL, WRONG, mark_legend, styled, write_plainly

__all__ = ["draw_similarity", "outline"]

_MOST_CELLS = 2048
"""A side with more cells than this is averaged down first: no picture shows them, and memory would double."""

_TRUTH = "white"
_RIGHT_MARK = "#56B4E9"


@styled()
def draw_similarity(
    axes: Axes,
    S: NDArray[Any],
    truth: NDArray[np.bool_] | None = None,
    *,
    best: bool = True,
    query: str = "query",
    database: str = "database",
    title: str = "",
) -> AxesImage:
    """Draws a similarity matrix as an image, rows = queries.

    Args:
        axes: Where to draw.
        S: M×N scores, higher = more alike.
        truth: M×N, true where the two frames show the same place; its cells get an outline.
        best: Whether to mark each query's best database frame: a ring when it is right, a cross when wrong
            (with no truth: a dot).
        query: Name of the query traverse.
        database: Name of the database traverse.
        title: Written above.

    Returns:
        The image, whose colour scale stands beside it.

    Raises:
        DescriptorsError: `S` is empty, or `truth` has another shape.
    """
    scores = np.asarray(S)
    if scores.ndim != 2 or scores.size == 0:
        raise DescriptorsError(f"cannot draw a similarity matrix of shape {scores.shape}; give M×N scores")
    if truth is not None and truth.shape != scores.shape:
        raise DescriptorsError(
            f"the truth has shape {truth.shape} and the similarity matrix {scores.shape}; "
            "make both from the same frames"
        )
    M, N = scores.shape
    shown, (down, across) = _averaged(scores)
    image = axes.imshow(
        shown,
        cmap=SEQUENTIAL,
        # The last block may be smaller; the limits below cut off what its picture has too much.
        extent=(-0.5, shown.shape[1] * across - 0.5, shown.shape[0] * down - 0.5, -0.5),
        # A very long matrix drawn with square cells would be a thread.
        aspect="equal" if 0.25 <= M / N <= 4.0 else "auto",
    )
    axes.set_xlim(-0.5, N - 0.5)
    axes.set_ylim(M - 0.5, -0.5)
    # An inset is as high as the matrix, whatever room its square cells leave in the figure.
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label="similarity")
    write_plainly(axes.set_xlabel(f"frame of {database}"), axes.set_ylabel(f"frame of {query}"))
    for side in (axes.xaxis, axes.yaxis):
        side.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if title:
        write_plainly(axes.set_title(title, fontsize=10.0))
    _draw_marks(axes, scores, truth, best=best)
    return image


def outline(truth: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Finds the edges between true and false cells.

    Args:
        truth: M×N.

    Returns:
        K×2×2: the two (x, y) ends of each edge of length one; cell (i, j) is centred at x = j, y = i.
    """
    padded = np.pad(np.asarray(truth, dtype=bool), 1)
    upright = np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])[:, ::-1] - 0.5
    level = np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])[:, ::-1] - 0.5
    return np.concatenate([
        np.stack([upright, upright + np.array([0.0, 1.0])], axis=1),
        np.stack([level, level + np.array([1.0, 0.0])], axis=1),
    ])  # fmt: skip


def _averaged(scores: NDArray[Any]) -> tuple[NDArray[Any], tuple[int, int]]:
    """Averages blocks of a matrix until no side has more than `_MOST_CELLS`; also gives the blocks' sides."""
    steps = (-(-scores.shape[0] // _MOST_CELLS), -(-scores.shape[1] // _MOST_CELLS))
    for axis, step in enumerate(steps):
        if step > 1:
            starts = np.arange(0, scores.shape[axis], step)
            sizes = np.diff(np.append(starts, scores.shape[axis]))
            sums = np.add.reduceat(scores, starts, axis=axis)
            scores = sums / np.expand_dims(sizes, 1 - axis).astype(sums.dtype)
    return scores, steps


def _draw_marks(axes: Axes, scores: NDArray[Any], truth: NDArray[np.bool_] | None, *, best: bool) -> None:
    """Marks truth and best matches, and explains the marks below the matrix."""
    marks: dict[str, Artist] = {}
    if truth is not None:
        marks["true place"] = _draw_truth(axes, truth)
    if best:
        marks |= _draw_best(axes, scores, truth)
    if marks:
        mark_legend(axes, marks)


def _draw_truth(axes: Axes, truth: NDArray[np.bool_]) -> Artist:
    """Outlines the true cells, thinner the more of them there are."""
    width = float(np.clip(60.0 / max(truth.shape), 0.5, 1.4))
    axes.add_collection(LineCollection(list(outline(truth)), colors=_TRUTH, linewidths=width), autolim=False)
    return Line2D([], [], color=_TRUTH, linewidth=1.4)


def _draw_best(axes: Axes, scores: NDArray[Any], truth: NDArray[np.bool_] | None) -> dict[str, Artist]:
    """Marks the best database frame of every query; the kinds that do not occur are not explained either."""
    M = len(scores)
    queries = np.arange(M)
    proposed = scores.argmax(axis=1)
    size = float(np.clip(240.0 / M, 2.4, 7.0))
    edge = float(np.clip(size / 5.0, 0.5, 1.3))
    if truth is None:
        kinds = {"best match": (np.ones(M, dtype=bool), ".", WRONG, WRONG)}
    else:
        right = truth[queries, proposed]
        kinds = {
            "best match, right": (right, "o", _RIGHT_MARK, "none"),
            "best match, wrong": (~right, "x", WRONG, WRONG),
        }
    marks: dict[str, Artist] = {}
    for name, (here, shape, colour, fill) in kinds.items():
        if here.any():
            look: dict[str, Any] = {
                "marker": shape,
                "color": colour,
                "markerfacecolor": fill,
                "linestyle": "none",
            }
            axes.plot(proposed[here], queries[here], markersize=size, markeredgewidth=edge, label=name, **look)
            marks[name] = Line2D([], [], markersize=6.0, markeredgewidth=1.2, **look)
    return marks
