from __future__ import annotations

import numpy as np
import pytest

from everplace.render.road import Biome, Column, make_road

ROAD = make_road(np.random.default_rng(4), 1500.0)


def test_arc_is_the_length_of_the_centre_line() -> None:
    x = ROAD.x_of_arc(np.array([0.0, 400.0, 1000.0]))
    assert x[0] == pytest.approx(0, abs=0.1)
    for begin, end, length in ((x[0], x[1], 400), (x[1], x[2], 600)):
        fine = np.linspace(begin, end, 4000)
        y = ROAD.lookup(fine.astype(np.float32))[:, Column.CENTRE].astype(np.float64)
        assert np.hypot(np.diff(fine), np.diff(y)).sum() == pytest.approx(length, rel=0.01)


def test_heading_is_the_direction_of_the_centre_line() -> None:
    for x in (50.0, 333.0, 1200.0):
        rise = ROAD.at(x + 4, Column.CENTRE) - ROAD.at(x - 4, Column.CENTRE)
        assert np.tan(ROAD.heading(x)) == pytest.approx(rise / 8, abs=0.03)


def test_the_road_bends_but_never_turns_back() -> None:
    headings = np.array([ROAD.heading(float(x)) for x in range(0, 1500, 10)])
    assert np.abs(headings).max() < 0.8
    assert headings.std() > 0.1


def test_stretches_follow_one_another_and_vary() -> None:
    for before, after in zip(ROAD.segments, ROAD.segments[1:], strict=False):
        assert before.end == after.start
        assert (before.left, before.right) != (after.left, after.right)
    assert Biome.VILLAGE in {segment.left for segment in ROAD.segments}
    assert len({segment.left for segment in ROAD.segments} | {segment.right for segment in ROAD.segments}) >= 6
