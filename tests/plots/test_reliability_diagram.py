from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.plots.canvas import new_axes, png_bytes
from everplace.plots.reliability_diagram import draw_reliability


@dataclass
class PlainBins:
    """Bins that come from nowhere."""

    counts: NDArray[np.int64]
    probability: NDArray[np.float64]
    right: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@pytest.fixture
def bins() -> PlainBins:
    counts = np.array([0, 0, 3, 0, 200])
    right = np.array([np.nan, np.nan, 1 / 3, np.nan, 0.95])
    return PlainBins(counts, np.array([np.nan, np.nan, 0.5, np.nan, 0.97]), right, right - 0.2, right + 0.05)


def test_bars_stand_where_answers_are(bins: PlainBins) -> None:
    figure, axes = new_axes(5, 4)
    bars = draw_reliability(axes, bins, error=0.1234)
    assert [bar.get_height() for bar in bars] == pytest.approx([1 / 3, 0.95])
    assert [bar.get_x() + bar.get_width() / 2 for bar in bars] == pytest.approx([0.5, 0.9])
    assert [text.get_text() for text in axes.texts] == ["3", "200"]
    assert axes.get_title(loc="left") == "calibration error 0.123, 203 answers"
    diagonal, points = axes.lines
    assert np.array_equal(diagonal.get_xdata(), diagonal.get_ydata())
    assert np.asarray(points.get_xdata()).tolist() == pytest.approx([0.5, 0.97])
    assert png_bytes(figure, 50)


def test_the_numbers_stay_inside(bins: PlainBins) -> None:
    figure, axes = new_axes(5, 4)
    bins.right[-1] = bins.low[-1] = bins.high[-1] = 1.0
    draw_reliability(axes, bins)
    assert png_bytes(figure, figure.dpi)
    inside = axes.get_window_extent()
    for text in axes.texts:
        assert inside.y0 <= text.get_window_extent().y0 < text.get_window_extent().y1 <= inside.y1
    assert axes.get_title(loc="left") == ""
