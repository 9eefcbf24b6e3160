"""Precision-recall curves as a plotly figure that answers where the pointer is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from everplace.plots.curves import Curve, from_recall_zero
from everplace.plots.style import LineLook, line_looks

__all__ = ["precision_recall_figure", "thinned"]


def precision_recall_figure(
    curves: Mapping[str, Curve],
    *,
    areas: Mapping[str, float] | None = None,
    looks: Mapping[str, LineLook] | None = None,
    most_points: int = 600,
) -> go.Figure:
    """Builds the curves of all methods; the pointer shows recall, precision and the threshold.

    Args:
        curves: One curve a method, in the order of the legend.
        areas: The `auc_pr` of methods, written beside their names.
        looks: Colours and dashes a method; by default those of `line_looks(curves)`.
        most_points: A curve with more points is thinned to about so many.

    Returns:
        A figure with a transparent ground, to stand on a light or dark page.
    """
    chosen = dict(looks) if looks is not None else line_looks(curves)
    figure = go.Figure(layout=_layout())
    for label, curve in curves.items():
        kept = thinned(len(curve.recall) + 1 if len(curve.recall) else 0, most_points)
        # plotly reads a few HTML tags in names; a method's name is no markup.
        name = label.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
        legend = f"{name}  {areas[label]:.3f}" if areas and label in areas else name
        figure.add_trace(
            go.Scatter(
                x=np.round(from_recall_zero(curve.recall, recall=True)[kept], 5),
                y=np.round(from_recall_zero(curve.precision)[kept], 5),
                customdata=from_recall_zero(curve.threshold)[kept],
                name=legend,
                mode="lines",
                line={"color": chosen[label].colour, "dash": chosen[label].plotly_dashes, "width": 2},
                hovertemplate=(
                    f"{name}<br>recall %{{x:.3f}}<br>precision %{{y:.3f}}"
                    "<br>threshold %{customdata:.4g}<extra></extra>"
                ),
            )
        )
    return figure


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Chooses points of a curve: all of a short one, else denser where a precision-recall curve changes fast.

    At the front every single proposal moves the precision, at the end hardly any does, so half of the points
    are spread evenly and half by ratio.

    Args:
        count: Points of the curve.
        most: About as many are kept.

    Returns:
        Rising indices; the first and the last point are always among them.
    """
    if count <= most:
        return np.arange(count)
    even = np.linspace(0, count - 1, max(2, most // 2))
    ratio = np.geomspace(1, count, max(2, most // 2)) - 1
    return np.unique(np.rint(np.concatenate([even, ratio])).astype(np.intp))


def _layout() -> go.Layout:
    """The layout: both axes from 0 to 1, the legend below so that a phone has room for the curves."""
    axis = {"gridcolor": "rgba(128,128,128,0.25)", "zeroline": False, "linecolor": "rgba(128,128,128,0.8)"}
    return go.Layout(
        template="none",
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "system-ui, sans-serif", "size": 13},
        margin={"l": 56, "r": 12, "t": 12, "b": 48},
        height=460,
        hovermode="closest",
        showlegend=True,
        legend={"orientation": "h", "yref": "container", "yanchor": "bottom", "y": 0.0, "x": 0.0},
        xaxis={"title": {"text": "recall", "standoff": 8}, "automargin": True, "range": [0, 1.01], **axis},
        yaxis={"title": {"text": "precision"}, "range": [0, 1.03], **axis},
    )
