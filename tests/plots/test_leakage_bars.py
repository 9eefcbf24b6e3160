from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex

from everplace.plots.canvas import new_axes, png_bytes
from everplace.plots.leakage_bars import draw_bars, draw_divergences


def test_bars_stand_in_order_with_their_values_and_the_line() -> None:
    figure, axes = new_axes(5, 2)
    bars = {"z_p": 0.7, "$z_c$": 0.1}
    drawn = draw_bars(axes, bars, colours=("#0072B2", "#D55E00"), line=("chance", 0.25), label="recall@1", upper=1.0)
    assert [bar.get_width() for bar in drawn] == [0.7, 0.1]
    assert [to_hex(bar.get_facecolor()).upper() for bar in drawn] == ["#0072B2", "#D55E00"]
    assert [text.get_text() for text in axes.texts] == ["0.70", "0.10"]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["z_p", "$z_c$"]
    assert axes.lines[0].get_xdata() == [0.25, 0.25]
    assert axes.get_xlabel() == "recall@1 (dashed: chance, 0.25)"
    # A value stands in front of the line that may run behind it, on ground of its own.
    assert all(text.get_zorder() > axes.lines[0].get_zorder() for text in axes.texts)
    for text in axes.texts:
        ground = text.get_bbox_patch()
        assert ground is not None
        assert to_hex(ground.get_facecolor(), keep_alpha=True) == "#ffffffff"
    # The first bar is the uppermost.
    top, bottom = (axes.transData.transform((0, bar.get_y()))[1] for bar in drawn)
    assert top > bottom
    assert png_bytes(figure, 50)


@pytest.mark.parametrize("values", [(0.0, 0.0), (0.004, 0.2)])
def test_bars_without_an_end_fit(values: tuple[float, float]) -> None:
    figure, axes = new_axes(5, 2)
    draw_bars(axes, dict(zip("ab", values, strict=True)), colours=("b", "r"), line=("x", 0.3), label="error")
    assert axes.get_xlim()[1] > 0.3
    assert png_bytes(figure, 50)


def test_divergences_fall_and_are_counted() -> None:
    figure, axes = new_axes(5, 2.5)
    lines = draw_divergences(axes, {"z_p": [0.0, 2.0, 0.5], "z_c": [0.005, 0.011]}, active_above=0.01)
    assert np.asarray(lines[0].get_ydata()).tolist() == pytest.approx([2.0, 0.5, 1e-5])  # 0 has no logarithm
    assert np.asarray(lines[1].get_ydata()).tolist() == pytest.approx([0.011, 0.005])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "z_p: 2 of 3 active", "z_c: 1 of 2 active", "active above 0.01",
    ]  # fmt: skip
    assert png_bytes(figure, figure.dpi)
    # The legend covers no curve and stays on the page.
    box, inside, page = legend.get_window_extent(), axes.get_window_extent(), figure.bbox
    assert inside.x1 <= box.x0 < box.x1 <= page.x1
