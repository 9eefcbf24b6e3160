from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from matplotlib.collections import LineCollection
from PIL import Image as PillowImage

from everplace.plots.canvas import new_axes, png_bytes
from everplace.plots.similarity_matrix import draw_similarity, outline

SCORES = np.array([[0.9, 0.1, 0.2], [0.3, 0.2, 0.8]], dtype=np.float32)
NAMED: Any = {"query": "q", "database": "d", "title": "t"}
TRUTH = np.array([[True, False, False], [False, True, False]])


def test_image_marks_and_outline_lie_on_their_cells() -> None:
    figure, axes = new_axes()
    image = draw_similarity(axes, SCORES, TRUTH, query="winter", database="summer", title="hog")
    np.testing.assert_array_equal(np.asarray(image.get_array()), SCORES)
    assert tuple(image.get_extent()) == (-0.5, 2.5, 1.5, -0.5)
    marks = {str(line.get_label()): np.asarray(line.get_xydata()).tolist() for line in axes.lines}
    assert marks == {"best match, right": [[0.0, 0.0]], "best match, wrong": [[2.0, 1.0]]}
    assert axes.lines[0].get_marker() != axes.lines[1].get_marker()
    (edges,) = (found for found in axes.collections if isinstance(found, LineCollection))
    assert len(edges.get_segments()) == 8
    assert (axes.get_ylabel(), axes.get_xlabel(), axes.get_title()) == (
        "frame of winter", "frame of summer", "hog",
    )  # fmt: skip
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "true place", "best match, right", "best match, wrong",
    ]  # fmt: skip
    assert png_bytes(figure, 50)


def test_a_kind_that_does_not_occur_is_not_explained() -> None:
    _, axes = new_axes()
    draw_similarity(axes, SCORES[:1], TRUTH[:1], **NAMED)
    assert [line.get_label() for line in axes.lines] == ["best match, right"]


def test_a_few_frames_are_named_at_their_places() -> None:
    figure, axes = new_axes()
    rows, columns = [f"{520 + place}" for place in range(40)], [f"$long_name_{place}$" for place in range(40)]
    draw_similarity(
        axes, np.eye(40), np.eye(40, dtype=bool), query_names=rows, database_names=columns, score="cosine similarity",
        query="q", database="d", title="hog", note="right: within ±1 frames",
    )  # fmt: skip
    for side, names in ((axes.yaxis, rows), (axes.xaxis, columns)):
        ticks = {
            int(place): text.get_text() for place, text in zip(side.get_ticklocs(), side.get_ticklabels(), strict=True)
        }
        assert 3 <= len(ticks) <= 9
        assert ticks == {place: names[place] for place in ticks}
    assert [text.get_rotation() for text in axes.get_yticklabels()[:1] + axes.get_xticklabels()[:1]] == [0.0, 30.0]
    assert [text.get_text() for text in axes.texts] == ["right: within ±1 frames"]
    assert "cosine similarity" in {child.get_ylabel() for child in axes.child_axes}
    # Neither the slanted names nor the axis label under them lie below the legend's upper edge.
    png_bytes(figure, figure.dpi)
    legend = axes.get_legend()
    assert legend is not None
    assert axes.xaxis.label.get_window_extent().y0 >= legend.get_window_extent().y1


@pytest.mark.parametrize("frames", [16, 120, 400])
def test_wrong_matches_can_be_seen_however_many_frames_there_are(frames: int) -> None:
    scores = np.eye(frames)
    scores[3] = np.roll(scores[3], 5)
    _, axes = new_axes(6.4, 5.6)
    draw_similarity(axes, scores, np.eye(frames, dtype=bool), **NAMED)
    right, wrong = axes.lines
    assert wrong.get_markersize() >= 4.5
    assert wrong.get_markersize() >= right.get_markersize()


def test_without_truth_nothing_is_marked() -> None:
    figure, axes = new_axes()
    draw_similarity(axes, SCORES, **NAMED)
    assert not axes.lines
    assert axes.get_legend() is None
    assert png_bytes(figure, 50)


def _edges_cell_by_cell(truth: np.ndarray) -> set[tuple[tuple[float, float], tuple[float, float]]]:
    """Each true cell has four edges; an edge that two true cells share is none."""
    edges: set[tuple[tuple[float, float], tuple[float, float]]] = set()
    for i, j in np.argwhere(truth).tolist():
        left, right, top, bottom = j - 0.5, j + 0.5, i - 0.5, i + 0.5
        for edge in (
            ((left, top), (left, bottom)),
            ((right, top), (right, bottom)),
            ((left, top), (right, top)),
            ((left, bottom), (right, bottom)),
        ):
            edges ^= {edge}
    return edges


@settings(max_examples=40)
@given(arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.booleans()))
def test_outline_equals_the_edges_found_cell_by_cell(truth: np.ndarray) -> None:
    found = [((a[0], a[1]), (b[0], b[1])) for a, b in outline(truth).tolist()]
    assert len(found) == len(set(found))
    assert set(found) == _edges_cell_by_cell(truth)


def test_a_large_matrix_is_averaged_and_keeps_its_scale() -> None:
    scores = np.repeat(np.arange(5000, dtype=np.float32)[None], 3, axis=0)
    figure, axes = new_axes(4, 3)
    image = draw_similarity(axes, scores, scores == 4999, **NAMED)
    shown = np.asarray(image.get_array())
    assert shown.shape == (3, 1667)
    np.testing.assert_allclose(shown[0, :2], [1.0, 4.0])
    assert shown[0, -1] == pytest.approx(4998.5)  # the last block holds two columns
    assert tuple(image.get_extent()) == (-0.5, 5000.5, 2.5, -0.5)  # 1,667 blocks of three
    assert axes.get_xlim() == (-0.5, 4999.5)
    assert np.asarray(axes.lines[0].get_xydata())[:, 0].tolist() == [4999.0] * 3
    assert axes.get_aspect() == "auto"
    assert png_bytes(figure, 50)


def test_one_cell() -> None:
    figure, axes = new_axes(3, 3)
    draw_similarity(axes, np.array([[0.5]]), np.array([[True]]), **NAMED)
    with PillowImage.open(io.BytesIO(png_bytes(figure, 50))) as picture:
        assert picture.size == (150, 150)
