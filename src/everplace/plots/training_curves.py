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

__all__ = ["TRAINING_CAPTION", "draw_training", "training_panels"]

TRAINING_CAPTION = (
    "Means over the frames of each epoch. Bound: what training maximises, with the weights of its terms. Image term: "
    "how likely the decoder makes the frame; sigma is the standard deviation that it allows a pixel value between 0 "
    "and 1. Condition term: how likely the true condition is by z_c; place term: how likely the true place is by z_p; "
    "both are 0 at best. KL: what each block tells of a frame, at most; a dimension with more than 0.01 nats is "
    "active. Held out: training places that change no weight. Dashed: the epoch that was kept."
)
"""What the panels of a training log show."""

_NOT_DRAWN = frozenset({"epoch", "step"})
_SHARED = {"kl": "KL per block (nats)", "active": "active dimensions", "free": "free bits (nats)"}
_SPLITS = ("train", "training", "val", "validation")
_TITLES = {
    "seconds": "time (s)",
    "bound": "bound (nats)",
    "image": "image term (nats)",
    "condition": "condition term (nats)",
    "place": "place term (nats)",
    "contrastive": "contrastive term (nats)",
    "adversary": "adversary (nats)",
    "swap": "swap reconstruction (nats)",
    "held_out_bound": "bound, held out (nats)",
    "held_out_recall_at_1": "recall@1, held out",
    "held_out_auc_pr": "auc_pr, held out",
}
_BLOCKS = {"place": "z_p", "condition": "z_c", "conditional": "z_c given its condition"}
"""What the columns of a shared panel are called, by the end of their names."""

_SHARES = ("recall", "auc_pr", "accuracy", "precision")
"""Quantities between 0 and 1, and drawn so: a flat one would else get an axis beyond."""


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
        panels.setdefault(_shared(quantity) or _TITLES.get(quantity, quantity.replace("_", " ")), []).append(name)
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
    shares = all(any(share in name.lower() for share in _SHARES) for name in names)
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
            clip_on=not shares,  # the lines of 0 and 1 are seen whole
        )
        handles.append(line)
        if chosen is not None:
            here = known & (epochs == chosen)
            axes.plot(epochs[here], values[here], "o", color=looks[name].colour, markersize=5.0)
    polish(axes)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    if shares:
        axes.set_ylim(0.0, 1.0)
    elif all(_quantity(name).lower().startswith("active") for name in names):
        axes.set_ylim(bottom=0.0)
    lines = math.ceil(len(names) / _LEGEND_COLUMNS) if len(names) > 1 else 0
    write_plainly(axes.set_title(title, fontsize=9.0, loc="left", pad=6.0 + 11.0 * lines))
    if chosen is not None:
        axes.axvline(chosen, color=CHOSEN, linestyle="--", linewidth=1.0, zorder=1.0)
    if lines:  # between the title and the axes, where it covers no curve
        set_legend(
            axes, handles, [_label(name) for name in names], loc="lower left", bbox_to_anchor=(0.0, 1.0),
            ncols=_LEGEND_COLUMNS, borderaxespad=0.1, borderpad=0.1, fontsize=7.0, columnspacing=1.2,
        )  # fmt: skip


_LEGEND_COLUMNS = 2


def _shared(quantity: str) -> str:
    """The title of the panel that a quantity shares with others; empty where it has its own."""
    return next((title for start, title in _SHARED.items() if quantity.lower().startswith(start)), "")


def _label(name: str) -> str:
    """What a column is called beside others of its panel: its block, its split, or both."""
    quantity = _quantity(name)
    split = name.lower().removesuffix(quantity.lower()).rstrip("_/")
    block = _BLOCKS.get(quantity.partition("_")[2], quantity.replace("_", " ")) if _shared(quantity) else ""
    return ", ".join(part for part in (block, split) if part) or quantity.replace("_", " ")


def _quantity(name: str) -> str:
    """The column's name without the split in front of it."""
    for split in _SPLITS:
        for joint in ("_", "/"):
            if name.lower().startswith(split + joint) and len(name) > len(split) + 1:
                return name[len(split) + 1 :]
    return name
