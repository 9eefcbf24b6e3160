"""Training curves: every quantity that training logs, by epoch, with the chosen epoch marked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from everplace.plots.style import CHOSEN, line_looks, polish, set_legend, styled, write_plainly

__all__ = ["draw_training", "training_panels"]

_NOT_DRAWN = frozenset({"epoch", "step"})
_SHARED = {"kl": "KL per block (nats)", "active": "active dimensions"}
_SPLITS = ("train", "training", "val", "validation")


def training_panels(names: Iterable[str]) -> dict[str, list[str]]:
    """Sorts columns into panels: what has one unit shares one.

    Columns that begin with `kl` share a panel, and so do those that begin with `active`; every other
    quantity has its own, because the terms of a bound differ by thousands. A `train_` or `validation_`
    (also `train/`, `val/`) in front does not count, so both curves of a quantity meet.

    Args:
        names: Columns, in any order; `epoch` and `step` are left out.

    Returns:
        The columns of each panel, both in the order in which they came.
    """
    panels: dict[str, list[str]] = {}
    for name in names:
        if name in _NOT_DRAWN:
            continue
        quantity = _quantity(name)
        title = next((title for start, title in _SHARED.items() if quantity.lower().startswith(start)), quantity)
        panels.setdefault(title.replace("_", " "), []).append(name)
    return panels


@styled()
def draw_training(
    figure: Figure,
    metrics: Mapping[str, NDArray[Any]],
    *,
    panels: Mapping[str, Iterable[str]] | None = None,
    chosen: int | float | None = None,
    columns: int = 3,
) -> list[Axes]:
    """Draws the columns of a training log against `epoch`.

    The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        metrics: Columns of one length, K values each; NaN where a row has no value. `epoch` is the abscissa
            (without it, the row's number).
        panels: Title and columns of each panel; by default `training_panels(metrics)`, without the columns
            that hold no number at all.
        chosen: The epoch whose model was kept; marked in every panel.
        columns: Panels beside each other.

    Returns:
        One axes a panel, in order.
    """
    if panels is None:
        filled = [name for name, values in metrics.items() if np.isfinite(np.asarray(values, dtype=float)).any()]
        panels = training_panels(filled)
    columns = max(1, min(columns, len(panels)))
    rows = max(1, math.ceil(len(panels) / columns))
    figure.set_size_inches(float(figure.get_figwidth()), 2.3 * rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False)
    every: list[Axes] = list(grid.flat)
    for axes in every[len(panels) :]:
        axes.remove()
    drawn = every[: len(panels)]
    for axes, (title, names) in zip(drawn, panels.items(), strict=True):
        _draw_panel(axes, metrics, title, list(names), chosen)
    if chosen is not None and drawn:
        drawn[0].set_title(f"chosen: epoch {chosen:g}", fontsize=8.0, color=CHOSEN, loc="right")
    for axes in drawn[max(0, len(drawn) - columns) :]:
        axes.set_xlabel("epoch" if "epoch" in metrics else "row")
    return drawn


def _draw_panel(
    axes: Axes, metrics: Mapping[str, NDArray[Any]], title: str, names: list[str], chosen: int | float | None
) -> None:
    """Draws one panel; points are joined across the gaps, since most rows hold only some of the columns."""
    looks = line_looks(names)
    handles = []
    for name in names:
        values = np.asarray(metrics[name], dtype=np.float64)
        epochs = np.asarray(metrics.get("epoch", np.arange(len(values))), dtype=np.float64)
        known = np.isfinite(values) & np.isfinite(epochs)
        (line,) = axes.plot(
            epochs[known],
            values[known],
            color=looks[name].colour,
            linestyle=looks[name].dashes,
            # A single point is no line: without its dot it could not be seen.
            marker="o" if known.sum() < 3 else None,
            markersize=3.5,
        )
        handles.append(line)
        if chosen is not None:
            here = known & (epochs == chosen)
            axes.plot(epochs[here], values[here], "o", color=looks[name].colour, markersize=5.0)
    polish(axes)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    write_plainly(axes.set_title(title, fontsize=9.0, loc="left"))
    if chosen is not None:
        axes.axvline(chosen, color=CHOSEN, linestyle="--", linewidth=1.0, zorder=1.0)
    if names != [title]:
        set_legend(axes, handles, names, loc="best", frameon=True, framealpha=0.8, fontsize=7.0)


def _quantity(name: str) -> str:
    """The column's name without the split in front of it."""
    for split in _SPLITS:
        for joint in ("_", "/"):
            if name.lower().startswith(split + joint) and len(name) > len(split) + 1:
                return name[len(split) + 1 :]
    return name
