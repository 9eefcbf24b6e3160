"""Precision-recall curves as a plotly figure that answers where the pointer is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from everplace.plots.precision_recall import Curve, from_recall_zero
from everplace.plots.style import line_looks

__all__ = ["precision_recall_figure", "thinned"]


_MOST_POINTS = 600
"""A curve with more points is thinned to about so many."""


def precision_recall_figure(curves: Mapping[str, Curve], *, areas: Mapping[str, float]) -> go.Figure:
    """Builds the curves of all methods; the pointer shows recall, precision and the threshold.

    Args:
        curves: One curve a method, in the order of the legend.
        areas: The `auc_pr` of each, written beside its name.

    Returns:
        A figure with a transparent ground, to stand on a light or dark page.
    """
    looks = line_looks(curves)
    figure = go.Figure(layout=_layout())
    for label, curve in curves.items():
        kept = thinned(len(curve.recall) + 1, _MOST_POINTS)
        # plotly reads a few HTML tags in names; a method's name is no markup.
        name = label.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
        figure.add_trace(
            go.Scatter(
                x=np.round(from_recall_zero(curve.recall, recall=True)[kept], 5),
                y=np.round(from_recall_zero(curve.precision)[kept], 5),
                customdata=from_recall_zero(curve.threshold)[kept],
                name=f"{name}  {areas[label]:.3f}",
                mode="lines",
                line={"color": looks[label].colour, "dash": looks[label].plotly_dashes, "width": 2},
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
