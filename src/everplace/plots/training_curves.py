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

_SHARED = {"kl": "KL per block (nats)", "active": "active dimensions"}
"""Panels that hold one curve a block, by how the names of their columns begin."""

_TITLES = {
    "seconds": "time (s)",
    "bound": "bound (nats)",
    "image": "image term (nats)",
    "condition": "condition term (nats)",
    "place": "place term (nats)",
    "held_out_bound": "bound, held out (nats)",
    "held_out_recall_at_1": "recall@1, held out",
    "held_out_auc_pr": "auc_pr, held out",
}
_BLOCKS = {"place": "z_p", "condition": "z_c"}
"""What the columns of a shared panel are called, by the end of their names."""

_SHARES = frozenset({"held_out_recall_at_1", "held_out_auc_pr"})
"""Quantities between 0 and 1, and drawn so: a flat one would else get an axis beyond."""

_COLUMNS, _LEGEND_COLUMNS = 3, 2


def training_panels(names: Iterable[str]) -> dict[str, list[str]]:
    """Sorts columns into panels: the blocks' KL share one, and so do their active dimensions.

    Every other quantity has its own, because the terms of a bound differ by thousands.

    Args:
        names: Columns, in any order; `epoch` is left out.

    Returns:
        The columns of each panel, both in the order in which they came.
    """
    panels: dict[str, list[str]] = {}
    for name in names:
        title = _SHARED.get(name.partition("_")[0]) or _TITLES.get(name, name.replace("_", " "))
        if name != "epoch":
            panels.setdefault(title, []).append(name)
    return panels


@styled()
def draw_training(figure: Figure, metrics: Mapping[str, NDArray[Any]], *, chosen: float) -> list[Axes]:
    """Draws the columns of a training log against `epoch`, but for those that hold no number at all.

    The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        metrics: `epoch` and other columns of one length, K values each; NaN where a row has no value.
        chosen: The epoch whose model was kept; marked in every panel.

    Returns:
        One axes a panel, in order.
    """
    panels = training_panels(name for name, values in metrics.items() if np.isfinite(values).any())
    columns = min(_COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure.set_size_inches(float(figure.get_figwidth()), 2.3 * rows + 0.3)
    every: list[Axes] = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in every[len(panels) :]:
        axes.remove()
    drawn = every[: len(panels)]
    for axes, (title, names) in zip(drawn, panels.items(), strict=True):
        _draw_panel(axes, metrics, title, names, chosen)
    drawn[0].set_title(f"chosen: epoch {chosen:g}", fontsize=8.0, color=CHOSEN, loc="right")
    for axes in drawn[-columns:]:
        axes.set_xlabel("epoch")
    return drawn


def _draw_panel(axes: Axes, metrics: Mapping[str, NDArray[Any]], title: str, names: list[str], chosen: float) -> None:
    """Draws one panel; points are joined across the gaps, since most rows hold only some of the columns."""
    looks = line_looks(names)
    shares = _SHARES.issuperset(names)
    handles = []
    epochs = metrics["epoch"]
    for name in names:
        values = metrics[name]
        known = np.isfinite(values)
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
        here = known & (epochs == chosen)
        axes.plot(epochs[here], values[here], "o", color=looks[name].colour, markersize=5.0)
    polish(axes)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=6))
    if shares:
        axes.set_ylim(0.0, 1.0)
    elif title == _SHARED["active"]:
        axes.set_ylim(bottom=0.0)
    lines = math.ceil(len(names) / _LEGEND_COLUMNS) if len(names) > 1 else 0
    write_plainly(axes.set_title(title, fontsize=9.0, loc="left", pad=6.0 + 11.0 * lines))
    axes.axvline(chosen, color=CHOSEN, linestyle="--", linewidth=1.0, zorder=1.0)
    if lines:  # between the title and the axes, where it covers no curve
        blocks = [name.partition("_")[2] for name in names]
        set_legend(
            axes, handles, [_BLOCKS.get(block, block) for block in blocks], loc="lower left", bbox_to_anchor=(0.0, 1.0),
            ncols=_LEGEND_COLUMNS, borderaxespad=0.1, borderpad=0.1, fontsize=7.0, columnspacing=1.2,
        )  # fmt: skip
