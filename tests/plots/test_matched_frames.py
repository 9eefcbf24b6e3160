"""The picture of where a drive's frames were found."""

from __future__ import annotations

import numpy as np

from everplace.plots.canvas import new_axes, svg_bytes
from everplace.plots.matched_frames import draw_matched_frames


def test_sure_and_refused_frames_are_points_at_their_places() -> None:
    figure, axes = new_axes()
    places, sure = np.array([4, 9, 6]), np.array([True, False, True])
    draw_matched_frames(axes, places, sure, drive="$w_", map_drive="summer", title="w on s")
    refused, believed = (np.asarray(marks.get_offsets()).tolist() for marks in axes.collections)
    assert refused == [[1, 9]]
    assert believed == [[0, 4], [2, 6]]
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["refused: 1", "sure: 2"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("frame of $w_", "place of summer")
    assert svg_bytes(figure)


def test_a_drive_without_sure_frames_can_be_drawn() -> None:
    figure, axes = new_axes()
    draw_matched_frames(axes, np.array([4, 9]), np.zeros(2, np.bool_), drive="w", map_drive="s", title="t")
    assert svg_bytes(figure)
