from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes

from everplace.plots.canvas import new_figure, png_bytes
from everplace.plots.training_curves import draw_training, training_panels

NAN = np.nan
METRICS = {
    "epoch": np.array([0.0, 0, 1, 1, 2, 2]),
    "bound": np.array([1.0, NAN, 2.0, NAN, 3.0, NAN]),
    "held_out_bound": np.array([NAN, 0.5, NAN, 1.5, NAN, 2.5]),
    "kl_place": np.array([9.0, NAN, 8.0, NAN, 7.0, NAN]),
    "kl_condition": np.array([3.0, NAN, 2.0, NAN, 1.0, NAN]),
    "active_place": np.array([NAN, 4, NAN, 5, NAN, 6]),
    "held_out_recall_at_1": np.array([NAN, 0.1, NAN, 0.6, NAN, 0.4]),
    "empty": np.full(6, NAN),
}


def _titles(axes: list[Axes]) -> list[str]:
    return [panel.get_title(loc="left") for panel in axes]


def test_columns_of_one_unit_share_a_panel() -> None:
    # A log of an earlier version may hold columns that nobody logs any more.
    assert training_panels(["epoch", "bound", "kl_place", "kl_condition", "kl_conditional", "lr", "x_1"]) == {
        "bound (nats)": ["bound"],
        "KL per block (nats)": ["kl_place", "kl_condition", "kl_conditional"],
        "lr": ["lr"],
        "x 1": ["x_1"],
    }


def test_curves_run_across_the_gaps_and_the_chosen_epoch_is_marked() -> None:
    figure = new_figure(10)
    axes = draw_training(figure, METRICS, chosen=1)
    assert _titles(axes) == [
        "bound (nats)",
        "bound, held out (nats)",
        "KL per block (nats)",
        "active dimensions",
        "recall@1, held out",
    ]
    recall = axes[4]
    curve, dot, rule = recall.lines
    assert np.asarray(curve.get_xydata()).tolist() == [[0, 0.1], [1, 0.6], [2, 0.4]]
    assert np.asarray(dot.get_xydata()).tolist() == [[1, 0.6]]
    assert np.asarray(rule.get_xdata()).tolist() == [1, 1]
    assert axes[0].get_title(loc="right") == "chosen: epoch 1"
    legend = axes[2].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["z_p", "z_c"]
    assert png_bytes(figure, 50)


def test_a_real_log_is_in_plain_words_and_no_legend_covers_a_curve() -> None:
    names = (
        "seconds", "learning_rate", "bound", "image", "kl_place", "kl_condition", "active_place", "active_condition",
        "sigma", "held_out_bound", "held_out_recall_at_1", "held_out_auc_pr",
    )  # fmt: skip
    metrics = {"epoch": np.array([1, 2, 3]), **{name: np.array([0.99, 0.99, 0.99]) for name in names}}
    figure = new_figure(10)
    axes = draw_training(figure, metrics, chosen=2)
    assert _titles(axes) == [
        "time (s)", "learning rate", "bound (nats)", "image term (nats)", "KL per block (nats)", "active dimensions",
        "sigma", "bound, held out (nats)", "recall@1, held out", "auc_pr, held out",
    ]  # fmt: skip
    assert png_bytes(figure, figure.dpi)
    for panel in axes:
        legend = panel.get_legend()
        assert (legend is None) == (len(panel.lines) == 3)  # curve, dot and rule
        if legend is not None:
            assert [text.get_text() for text in legend.get_texts()] == ["z_p", "z_c"]
            assert legend.get_window_extent().y0 >= panel.get_window_extent().y1


@pytest.mark.parametrize("recall", [(1.0, 1.0), (0.0, 0.0), (0.2, 0.9)])
def test_a_share_is_drawn_between_none_and_all(recall: tuple[float, float]) -> None:
    metrics = {"epoch": np.array([1, 2]), "held_out_recall_at_1": np.array(recall)}
    (axes,) = draw_training(new_figure(), metrics, chosen=1)
    assert axes.get_ylim() == (0.0, 1.0)
    assert not axes.lines[0].get_clip_on()


def test_one_epoch_is_a_visible_dot() -> None:
    (axes,) = draw_training(new_figure(), {"epoch": np.array([0]), "bound": np.array([1.0])}, chosen=0)
    assert axes.lines[0].get_marker() == "o"
