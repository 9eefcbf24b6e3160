"""The parts of a leakage audit: measures as bars beside what costs nothing, and the divergence of each dimension."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import BarContainer
from matplotlib.lines import Line2D

from everplace.plots.style import COLOURS, INK, MUTED, polish, set_legend, styled, write_plainly

__all__ = ["draw_bars", "draw_divergences"]


@styled()
def draw_bars(
    axes: Axes,
    bars: Mapping[str, float],
    *,
    colours: Sequence[str],
    line: tuple[str, float],
    label: str,
    upper: float | None = None,
    digits: int = 2,
) -> BarContainer:
    """Draws one bar a measure, from the top, each with its value, and a line that all are compared with.

    Args:
        axes: Where to draw.
        bars: K values, none negative.
        colours: K colours.
        line: Name and value of what costs nothing.
        label: Written below the scale.
        upper: Where the scale ends; by default a little above the highest value.
        digits: Decimals of the values.

    Returns:
        The bars, in order.
    """
    names, values = list(bars), list(bars.values())
    drawn = axes.barh(range(len(names)), values, height=0.62, color=list(colours))
    end = upper if upper is not None else 1.05 * max([*values, line[1], 1e-9])
    polish(axes)
    axes.grid(visible=False, axis="y")
    axes.set_xlim(0.0, 1.12 * end)  # room for the value beside the longest bar
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_yticks(range(len(names)), names)
    for tick in axes.get_yticklabels():
        write_plainly(tick)
    axes.tick_params(axis="y", length=0.0, labelcolor=INK)
    write_plainly(axes.set_xlabel(f"{label} (dashed: {line[0]}, {line[1]:.{digits}f})"))
    axes.axvline(line[1], color=INK, linestyle="--", linewidth=1.2, zorder=2.0)
    for place, value in enumerate(values):
        axes.text(
            value + 0.01 * end,
            place,
            f"{value:.{digits}f}",
            va="center",
            fontsize=8.0,
            color=INK,
            bbox=_PAPER,
            zorder=4.0,
        )
    return drawn


@styled()
def draw_divergences(axes: Axes, blocks: Mapping[str, Sequence[float]], *, active_above: float) -> list[Line2D]:
    """Draws the mean KL divergence of every dimension of each block, largest first, on a logarithmic scale.

    Args:
        axes: Where to draw.
        blocks: By name, the divergence of each dimension in nats; what is below a thousandth of `active_above` is
            drawn there.
        active_above: The divergence above which a dimension counts as active.

    Returns:
        One line a block.
    """
    lines = []
    for (name, values), colour in zip(blocks.items(), COLOURS, strict=False):
        falling = np.sort(np.asarray(values, dtype=np.float64))[::-1]
        drawn = np.maximum(falling, active_above / 1000.0)
        (curve,) = axes.step(np.arange(1, len(drawn) + 1), drawn, where="mid", color=colour, label=name)
        lines.append(curve)
    polish(axes)
    axes.set_yscale("log")
    axes.set_xlim(left=0.5)
    axes.set_xlabel("dimension, sorted")
    axes.set_ylabel("KL (nats)")
    threshold = axes.axhline(active_above, color=MUTED, linestyle="--", linewidth=1.2)
    counts = [sum(value > active_above for value in values) for values in blocks.values()]
    names = [
        f"{name}: {count} of {len(values)} active" for (name, values), count in zip(blocks.items(), counts, strict=True)
    ]
    set_legend(
        axes, [*lines, threshold], [*names, f"active above {active_above:g}"],
        loc="upper left", bbox_to_anchor=(1.0, 1.0),  # a curve may run anywhere inside
    )  # fmt: skip
    return lines


_PAPER: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 1.2}
"""Behind a value, so that the line does not run through it."""
