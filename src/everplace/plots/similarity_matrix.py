"""The similarity matrix, with its truth outlined and every query's best match marked right or wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.collections import LineCollection
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from everplace.plots.style import INK, MUTED, SEQUENTIAL, WRONG, mark_legend, shortened, styled, write_plainly

__all__ = ["draw_similarity", "outline"]

_MOST_CELLS = 2048
"""A side with more cells than this is averaged down first: no picture shows them, and memory would double."""

_TRUTH = "white"
_RIGHT_MARK = "#56B4E9"
_BEST_MARK = "white"
_SIDE = 1.0
_UNDER = 1.2
"""Inches for the name of a frame beside the matrix and below it."""

_LEVEL = 7
"""Names with more characters than this would touch each other below the matrix, so they are slanted."""


@styled()
def draw_similarity(
    axes: Axes,
    S: NDArray[Any],
    truth: NDArray[np.bool_] | None = None,
    *,
    query: str,
    database: str,
    query_names: Sequence[str] = (),
    database_names: Sequence[str] = (),
    score: str = "similarity",
    title: str,
    note: str = "",
    mark_best: bool = False,
) -> AxesImage:
    """Draws a similarity matrix as an image, rows = queries.

    Args:
        axes: Where to draw.
        S: M×N scores, higher = more alike.
        truth: M×N, true where the two frames show the same place; its cells get an outline, and each query's best
            database frame a ring when it is right, a cross when wrong. None: nobody knows.
        query: Name of the query traverse.
        database: Name of the database traverse.
        query_names: M names of frames, of which a few stand at the side; without them rows are counted from 0.
        database_names: N names, likewise.
        score: What the numbers are, written beside the colours.
        title: Written above.
        note: Written between the title and the matrix, smaller.
        mark_best: Mark the best database frame of each query also where the truth is not known.

    Returns:
        The image, whose colour scale stands beside it.
    """
    M, N = S.shape
    shown, (down, across) = _averaged(S)
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
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label=score)
    write_plainly(axes.set_xlabel(f"frame of {database}"), axes.set_ylabel(f"frame of {query}"))
    _write_ticks(axes.yaxis, query_names, _SIDE)
    slanted = _write_ticks(axes.xaxis, database_names, _UNDER)
    _write_above(axes, title, note)
    if truth is not None:
        marks = {"true place": _draw_truth(axes, truth), **_draw_best(axes, S, truth)}
        mark_legend(axes, marks, below=40.0 + slanted)
    elif mark_best:
        mark_legend(axes, _draw_best(axes, S, None), below=40.0 + slanted)
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


def _write_ticks(side: Axis, names: Sequence[str], room: float) -> float:
    """Writes a few names of frames at an axis, each in `room` inches, or lets it count where there are none.

    Returns:
        Points that names below the matrix need more than numbers, because they are slanted; 0 at its side.
    """
    if not names:
        side.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        return 0.0
    locator = MaxNLocator(nbins=7, integer=True, min_n_ticks=1)
    places = [int(place) for place in locator.tick_values(0, len(names) - 1) if 0 <= place < len(names)]
    size = 8.0
    side.set_ticks(places, [shortened(names[place], room, size) for place in places])
    labels = side.get_ticklabels()
    write_plainly(*labels)
    longest = max(len(label.get_text()) for label in labels)
    if not isinstance(side, XAxis) or longest <= _LEVEL:
        return 0.0
    for label in labels:
        label.set(rotation=30.0, ha="right", rotation_mode="anchor")
    return 0.3 * size * longest  # half of a text's length, at 30 degrees, of 0.6 em a character


def _write_above(axes: Axes, title: str, note: str) -> None:
    """Writes the title, over the note where there is one."""
    write_plainly(axes.set_title(title, fontsize=10.0, pad=20.0 if note else None))
    if note:
        write_plainly(
            axes.annotate(
                note, (0.5, 1.0), (0.0, 6.0), xycoords="axes fraction", textcoords="offset points",
                ha="center", va="bottom", fontsize=8.0, color=MUTED,
            )
        )  # fmt: skip


def _draw_truth(axes: Axes, truth: NDArray[np.bool_]) -> Artist:
    """Outlines the true cells, thinner the more of them there are."""
    width = float(np.clip(100.0 / max(truth.shape), 0.4, 1.2))
    lines = LineCollection(list(outline(truth)), colors=_TRUTH, linewidths=width, capstyle="projecting")
    lines.set_path_effects(_dark_edge(width))
    axes.add_collection(lines, autolim=False)
    return Line2D([], [], color=_TRUTH, linewidth=1.4)


def _draw_best(axes: Axes, scores: NDArray[Any], truth: NDArray[np.bool_] | None) -> dict[str, Artist]:
    """Marks the best database frame of every query; the kinds that do not occur are not explained either."""
    M = len(scores)
    queries = np.arange(M)
    proposed = scores.argmax(axis=1)
    # Right matches lie close together within the outline, which they must not cover; wrong ones lie apart.
    size = float(np.clip(400.0 / M, 2.4, 7.0))
    apart = float(np.clip(800.0 / M, 4.5, 8.0))
    if truth is None:
        kinds = {"best match": (np.ones(M, np.bool_), "o", _BEST_MARK, "none", size)}
    else:
        right = truth[queries, proposed]
        kinds = {
            "best match, right": (right, "o", _RIGHT_MARK, "none", size),
            "best match, wrong": (~right, "x", WRONG, WRONG, apart),
        }
    marks: dict[str, Artist] = {}
    for name, (here, shape, colour, fill, points) in kinds.items():
        if here.any():
            look: dict[str, Any] = {"marker": shape, "color": colour, "markerfacecolor": fill, "linestyle": "none"}
            edge = float(np.clip(points / 5.0, 0.5, 1.3))
            (drawn,) = axes.plot(
                proposed[here], queries[here], markersize=points, markeredgewidth=edge, label=name, **look
            )
            drawn.set_path_effects(_dark_edge(edge))
            marks[name] = Line2D([], [], markersize=6.0, markeredgewidth=1.2, **look)
    return marks


def _dark_edge(width: float) -> list[AbstractPathEffect]:
    """Sets a line of so many points off from the bright end of the colour map; a thin one would drown in its edge."""
    return [withStroke(linewidth=width + float(np.clip(2.0 * width - 0.8, 0.0, 0.9)), foreground=INK)]
