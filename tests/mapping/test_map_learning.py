"""What a map learns: which frames calibrate it, and what the last ten of them say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from everplace.mapping.calibration import PROVISIONAL, likelihood_ratios_of
from everplace.mapping.frame_window import MAP_MODEL
from everplace.mapping.map_learning import _sequence_answers, _whole_stretches
from everplace.sequences.belief import Belief


@given(count=st.integers(1, 30_000))
def test_frames_in_a_row_stay_in_a_row(count: int) -> None:
    chosen = _whole_stretches(count)
    assert (np.diff(chosen) > 0).all()
    assert chosen.max(initial=0) < count
    assert len(chosen) <= 2000
    if count <= 1992:
        assert len(chosen) == count
    assert len(chosen) >= min(count, 1992) - 24
    np.testing.assert_array_equal(np.flatnonzero(np.diff(chosen) > 1) % 24, 23)


def test_a_window_holds_frames_in_a_row_alone() -> None:
    """Frames after a gap, or of another drive, are answered as if nothing had been seen before."""
    rng = np.random.default_rng(0)
    true = np.r_[0:20, 60:80]
    scores = rng.normal(size=(40, 90)).astype(np.float32)
    scores[np.arange(40), true] += 2
    apart = np.arange(40) == 20
    probability, right = _sequence_answers(scores, true, apart, PROVISIONAL)
    for query, first in ((19, 10), (20, 20), (24, 20), (35, 26)):
        belief = Belief.start(MAP_MODEL, 1, 90)
        for number, row in enumerate(scores[first : query + 1]):
            if number:
                belief.move(MAP_MODEL)
            belief.see(likelihood_ratios_of(row, PROVISIONAL))
        posterior = belief.places[0]
        place = int(MAP_MODEL.worth(posterior[None])[0].argmax())
        assert probability[query] == pytest.approx(posterior[max(place - 1, 0) : place + 2].sum(), rel=1e-5)
        assert right[query] == (abs(place - true[query]) <= 1)
    joined, _ = _sequence_answers(scores, true, np.zeros(40, np.bool_), PROVISIONAL)
    assert joined[20] != pytest.approx(probability[20])
