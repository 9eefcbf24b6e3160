"""A reliability diagram: how often answers are right, by the probability that they were given."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from numpy.typing import NDArray

from everplace.plots.style import INK, MUTED, RIGHT, polish, set_legend, styled

__all__ = ["draw_reliability"]


class Bins(Protocol):
    """As `everplace.mapping.reliability.ReliabilityBins`: K values each, NaN where a bin is empty."""

    @property
    def counts(self) -> NDArray[np.int64]: ...
    @property
    def probability(self) -> NDArray[np.float64]: ...
    @property
    def right(self) -> NDArray[np.float64]: ...
    @property
    def low(self) -> NDArray[np.float64]: ...
    @property
    def high(self) -> NDArray[np.float64]: ...


@styled()
def draw_reliability(axes: Axes, bins: Bins, *, error: float | None = None) -> BarContainer:
    """Draws the bins, the numbers of answers in them, and the diagonal on which they would lie.

    Bars are the shares of right answers with their intervals; a point stands at the mean probability of its bin. Points
    above the diagonal say too little, points below it promise too much.

    Args:
        axes: Where to draw.
        bins: At least one bin with an answer.
        error: Expected calibration error, written above; None: nothing is.

    Returns:
        The bars, one for each bin with an answer.
    """
    edges = np.linspace(0.0, 1.0, len(bins.counts) + 1)
    filled = np.flatnonzero(bins.counts)
    centres, width = (edges[:-1] + edges[1:])[filled] / 2, edges[1]
    right, low, high = bins.right[filled], bins.low[filled], bins.high[filled]
    bars = axes.bar(centres, right, width=0.88 * width, color=RIGHT, alpha=0.35)
    axes.vlines(centres, low, high, color=RIGHT, linewidth=1.4)
    (diagonal,) = axes.plot([0, 1], [0, 1], linestyle="--", color=MUTED, linewidth=1.2)
    (given,) = axes.plot(bins.probability[filled], right, "o", color=INK, markersize=3.5, zorder=3.0)
    for centre, top, count in zip(centres, np.fmax(high, right), bins.counts[filled], strict=True):
        axes.annotate(
            f"{count}", (centre, top), (0, 3), textcoords="offset points", ha="center", fontsize=6.5, color=INK,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6}, zorder=4.0,
        )  # fmt: skip
    polish(axes)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.2)  # room for the numbers over full bars, and for the legend
    axes.set_yticks(np.linspace(0, 1, 6))
    axes.set_xlabel("probability of the answer")
    axes.set_ylabel("share that is right")
    if error is not None:
        axes.set_title(f"calibration error {error:.3f}, {int(bins.counts.sum())} answers", loc="left")
    set_legend(
        axes, [bars.patches[0], given, diagonal],
        ["share that is right, 95 % interval", "mean probability", "probability kept"],
        loc="upper center", ncols=3, fontsize=7.5, columnspacing=1.2,
    )  # fmt: skip
    return bars
