"""The last views of a drive, among them one that comes again and again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.errors import MapError
from everplace.mapping.calibration import PROVISIONAL, likelihood_ratios_of
from everplace.mapping.frame_window import MAP_MODEL, FrameWindow, state_width
from everplace.sequences.belief import Belief
from everplace.sequences.route_model import RouteModel

PLACES = 90
STOP = 500


def drive(true: Sequence[int], away: float = 2.5) -> NDArray[np.float64]:
    """Scores of frames that show the places `true`; -1: none of the map."""
    scores = np.random.default_rng(0).normal(size=(len(true), PLACES))
    for row, place in zip(scores, true, strict=True):
        if place >= 0:
            row[place] += away
    return scores


def replayed(scores: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Every frame heard, by the forward recursion alone."""
    belief = Belief.start(MAP_MODEL, 1, PLACES)
    for number, row in enumerate(scores):
        if number:
            belief.move(MAP_MODEL)
        belief.see(likelihood_ratios_of(row, PROVISIONAL))
    return belief.places[0], float(belief.off[0])


def noisy(row: NDArray[np.float64], copies: int, amount: float = 0.02) -> NDArray[np.float64]:
    return row + amount * np.random.default_rng(1).normal(size=(copies, PLACES))


@pytest.mark.parametrize("length", [2, 5, 10])
def test_new_frames_are_answered_from_the_last_ones_alone(length: int) -> None:
    scores = drive(range(20, 45))
    window = FrameWindow(length, PROVISIONAL)
    for number, row in enumerate(scores):
        places, off = window.add(row)
        wanted, wanted_off = replayed(scores[max(number - length + 1, 0) : number + 1])
        np.testing.assert_allclose(places, wanted, rtol=1e-9, atol=1e-15)
        assert off == pytest.approx(wanted_off, rel=1e-9)
        assert places.sum() + off == pytest.approx(1)


@pytest.mark.parametrize(
    ("true", "away"),
    [([*range(20, 40)], 2.5), ([*range(20, 40)], 4.0), ([*range(20, 39), -1], 4.0), ([-1] * 20, 0.0)],
    ids=["at its place", "clearly there", "with a view that says nothing", "off the map"],
)
def test_a_stop_neither_forgets_the_approach_nor_grows_sure(true: list[int], away: float) -> None:
    scores = drive(true, away)
    window = FrameWindow(10, PROVISIONAL)
    for row in scores:
        before, off_before = window.add(row)
    for row in noisy(scores[-1], STOP):
        places, off = window.add(row)
    assert off == pytest.approx(off_before, abs=0.1)
    if true[-1] >= 0:  # where nothing is seen, it may have driven on
        assert before[38:41].sum() > 0.5
        assert places[38:41].sum() == pytest.approx(before[38:41].sum(), abs=0.1)
    assert places.max() < before.max() + 0.05
    _, off_forgotten = replayed(noisy(scores[-1], 10))  # the last frames, each heard
    assert abs(off_forgotten - off_before) > 0.15


def test_after_a_stop_it_goes_on_with_the_views_before() -> None:
    scores = drive(range(20, 45))
    halting, through = FrameWindow(10, PROVISIONAL), FrameWindow(10, PROVISIONAL)
    for number, row in enumerate(scores):
        places, _ = halting.add(row)
        wanted, _ = through.add(row)
        if number == 20:
            for again in noisy(row, STOP):
                halting.add(again)
        if number > 21:
            assert places.argmax() == wanted.argmax()
            assert places[20 + number - 1 : 20 + number + 2].sum() > 0.5


@pytest.mark.parametrize("again", [0, 3])
@pytest.mark.parametrize(("length", "other_length"), [(10, 4), (4, 10), (10, 1)])
def test_a_state_is_gone_on_with_by_a_window_of_another_length(length: int, other_length: int, again: int) -> None:
    scores = drive(range(20, 45))
    window, other = FrameWindow(length, PROVISIONAL), FrameWindow(other_length, PROVISIONAL)
    for row in [*scores[:15], *noisy(scores[14], again)]:
        window.add(row)
    other.restore(np.array(window.state()))
    assert len(other.state()) == min(length, other_length)
    np.testing.assert_array_equal(other.state(), window.state()[-other_length:])


@pytest.mark.parametrize("stood", [STOP, 10**9])
def test_how_long_it_stood_costs_no_time(stood: int) -> None:
    scores = drive(range(20, 45))
    window = FrameWindow(10, PROVISIONAL)
    for row in [*scores[:12], *noisy(scores[11], 3)]:
        window.add(row)
    state = np.array(window.state())
    state[-1, PLACES] = stood
    moves = 0
    move = Belief.move

    def counted(self: Belief, model: RouteModel) -> None:
        nonlocal moves
        moves += 1
        move(self, model)

    other = FrameWindow(10, PROVISIONAL)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Belief, "move", counted)
        other.restore(state)
    assert moves == 0
    assert other.state()[-1][PLACES] == stood


def _set(state: NDArray[np.float64], at: tuple[int, int], value: float) -> NDArray[np.float64]:
    changed = state.copy()
    changed[at] = value
    return changed


@pytest.mark.parametrize(
    ("column", "value"),
    [
        (0, np.inf), (PLACES, np.nan), (PLACES, np.inf), (PLACES, 0.0), (PLACES, -2.0), (PLACES, 1.5),
        (PLACES + 1, np.nan), (PLACES + 5, -0.5), (PLACES + 5, 0.5), (PLACES + 5, np.inf), (-1, np.nan),
    ],
)  # fmt: skip
def test_numbers_that_are_no_state_are_refused(column: int, value: float) -> None:
    scores = drive(range(20, 45))
    window = FrameWindow(10, PROVISIONAL)
    for row in scores[:5]:
        window.add(row)
    before = np.array(window.state())
    with pytest.raises(MapError, match=r"this state is damaged: it holds numbers .*; begin anew"):
        window.restore(_set(before, (1, column), value))
    np.testing.assert_array_equal(window.state(), before)


@pytest.mark.parametrize(("before", "again"), [(3, 0), (15, 0), (15, 1), (15, STOP)])
def test_a_state_is_gone_on_with_to_the_last_bit(before: int, again: int) -> None:
    scores = drive(range(20, 45))
    scores[3, 5:9] = np.nan
    window, other = FrameWindow(10, PROVISIONAL), FrameWindow(10, PROVISIONAL)
    for row in [*scores[:before], *noisy(scores[before - 1], again)]:
        window.add(row)
    for row in scores[:7]:
        other.add(row)  # is forgotten
    other.restore(np.array(window.state()))
    assert np.shape(window.state()) == (min(before, 10), state_width(PLACES))
    for row in [*noisy(scores[before - 1], 3), *scores[before:]]:
        (places, off), (wanted, wanted_off) = other.add(row), window.add(row)
        np.testing.assert_array_equal(places, wanted)
        assert off == wanted_off
