from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from everplace.plots.canvas import new_figure, png_bytes
from everplace.plots.match_gallery import Match, draw_matches
from everplace.plots.style import RIGHT, WRONG


def _match(value: int, *, right: bool | None, true: bool = True, shape: tuple[int, ...] = (8, 16, 3)) -> Match:
    image = np.full(shape, value, np.uint8)
    names = (f"q{value}", f"p{value}", f"t{value}")
    return Match(image, image + 1, image + 2 if true else None, value / 100, right, *names)


def test_right_and_wrong_differ_by_colour_word_and_line() -> None:
    figure = new_figure(6)
    axes = draw_matches(figure, [_match(10, right=True), _match(20, right=False)], title="Two", note="within ±1")
    shown = [int(np.asarray(image.get_array())[0, 0, 0]) for image in axes.images]
    assert shown == [10, 11, 12, 20, 21, 22]
    right, wrong = (patch for patch in axes.patches if isinstance(patch, Rectangle))
    assert to_hex(right.get_edgecolor()).upper() == RIGHT
    assert to_hex(wrong.get_edgecolor()).upper() == WRONG
    assert right.get_linestyle() in ("-", "solid")
    assert wrong.get_linestyle() not in ("-", "solid")
    # The frame lies around the proposal, not around another image.
    x0, x1, y1, y0 = axes.images[1].get_extent()
    assert (right.get_x(), right.get_y()) == (x0, y0)
    assert (right.get_width(), right.get_height()) == pytest.approx((x1 - x0, y1 - y0))
    words = [text.get_text() for text in axes.texts]
    assert {
        "Two",
        "within ±1",
        "query",
        "proposed",
        "true",
        "✓ right  0.100",
        "✗ wrong  0.200",
        "q10",
        "p10",
        "t20",
    } <= set(words)


def test_a_note_takes_room_of_its_own() -> None:
    axes = draw_matches(new_figure(6), [_match(10, right=True)], title="Title", note="note")
    below = {text.get_text(): text.get_position()[1] for text in axes.texts}
    assert below["Title"] < below["note"] < below["query"] < axes.images[0].get_extent()[3]


def test_a_query_whose_place_is_not_there_says_so() -> None:
    axes = draw_matches(new_figure(6), [_match(10, right=False, true=False)], title="t", note="n")
    assert len(axes.images) == 2
    words = [text.get_text() for text in axes.texts]
    assert "not in the database" in words
    assert "t10" not in words


@pytest.mark.parametrize("shape", [(8, 16, 1), (16, 8, 3)])
@pytest.mark.parametrize("count", [1, 9])
def test_nothing_overlaps_and_everything_is_on_the_page(count: int, shape: tuple[int, ...]) -> None:
    figure = new_figure(7)
    axes = draw_matches(
        figure, [_match(number, right=True, shape=shape) for number in range(count)], title="t", note="n"
    )
    width, height = figure.get_size_inches()
    assert width == 7
    boxes = [image.get_extent() for image in axes.images]
    assert len(boxes) == 3 * count
    for number, (x0, x1, y1, y0) in enumerate(boxes):
        assert 0 <= x0 < x1 <= width
        assert 0 <= y0 < y1 <= height
        assert (y1 - y0) / (x1 - x0) == pytest.approx(shape[0] / shape[1])
        for u0, u1, v1, v0 in boxes[:number]:
            assert x1 <= u0 or u1 <= x0 or y1 <= v0 or v1 <= y0
    assert all(0 <= text.get_position()[1] <= height for text in axes.texts)
    assert png_bytes(figure, 50)


@pytest.mark.parametrize("count", [1, 3, 8])
def test_where_nobody_knows_what_is_right_there_is_the_score_alone(count: int) -> None:
    figure = new_figure(6)
    matches = [_match(number, right=None, true=False) for number in range(10, 10 + count)]
    axes = draw_matches(figure, matches, title="t", note="n")
    words = [text.get_text() for text in axes.texts]
    assert {f"{number / 100:.3f}" for number in range(10, 10 + count)} <= set(words)
    said = " ".join(words)
    assert not [word for word in ("true", "not in the database", "right", "wrong", "t10") if word in said]
    assert len(axes.images) == 2 * count
    edges = {to_hex(patch.get_edgecolor()).upper() for patch in axes.patches if isinstance(patch, Rectangle)}
    assert not edges & {RIGHT, WRONG}
    # What the true frame would have taken, the two others have.
    x0, x1, *_ = axes.images[-1].get_extent()
    assert (x1 - x0) > 0.9 * (6 if count < 4 else 3) / 2 - 0.4
