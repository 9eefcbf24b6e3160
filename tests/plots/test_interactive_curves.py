from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.plots.interactive_curves import precision_recall_figure, thinned
from everplace.plots.precision_recall import Curve
from everplace.plots.style import COLOURS

Make = Callable[[list[float], list[float]], Curve]


def test_traces_hold_curve_threshold_name_and_colour(make_curve: Make) -> None:
    curve = make_curve([0.2, 0.8], [1.0, 0.6])
    figure = precision_recall_figure({"hog": curve, "<b>": curve}, areas={"hog": 0.4022, "<b>": 0.5})
    hog, odd = figure.data
    np.testing.assert_allclose(hog.x, [0.0, 0.2, 0.8])
    np.testing.assert_allclose(hog.y, [1.0, 1.0, 0.6])
    np.testing.assert_allclose(hog.customdata, [0.9, 0.9, 0.1])
    assert hog.name == "hog  0.402"
    assert odd.name == "&lt;b&gt;  0.500"
    assert "threshold %{customdata" in hog.hovertemplate
    assert [trace.line.color for trace in figure.data] == list(COLOURS[:2])
    assert figure.layout.paper_bgcolor == "rgba(0,0,0,0)"


def test_long_curves_are_thinned_and_keep_their_ends(make_curve: Make) -> None:
    recall = np.linspace(1e-4, 0.9, 20_000).tolist()
    (trace,) = precision_recall_figure({"hog": make_curve(recall, recall)}, areas={"hog": 0.5}).data
    assert 300 < len(trace.x) <= 600
    assert (trace.x[0], trace.x[-1]) == (0.0, 0.9)


@settings(max_examples=50)
@given(st.integers(0, 3000), st.integers(4, 300))
def test_thinned_rises_from_first_to_last(count: int, most: int) -> None:
    kept = thinned(count, most)
    assert len(kept) <= max(most, 4)
    assert (np.diff(kept) > 0).all()
    if count:
        assert (kept[0], kept[-1]) == (0, count - 1)
    if count <= most:
        assert len(kept) == count
