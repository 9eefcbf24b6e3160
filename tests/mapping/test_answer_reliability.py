"""Whether a map's answers keep their word: the numbers of `map info` and its picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from everplace.mapping.answer_reliability import answer_reliability, reliability_figure
from everplace.mapping.held_out_answers import HeldOutAnswers
from everplace.mapping.route_map import Map
from everplace.plots.canvas import png_bytes


class Held:
    """A map's answers that were held out."""

    def __init__(self, probability: np.ndarray, right: np.ndarray) -> None:
        self.held_out_answers = HeldOutAnswers(probability.astype(np.float32), right, np.ones(len(right), np.bool_))


def answers(count: int) -> Held:
    rng = np.random.default_rng(0)
    probability = rng.uniform(size=count) ** 0.3
    return Held(probability, rng.uniform(size=count) < probability)


def test_numbers_of_answers_that_keep_their_word() -> None:
    found = answer_reliability(answers(2000))  # type: ignore[arg-type]
    assert found is not None
    assert found.bins.counts.sum() == found.answers == 2000
    assert len(found.bins.counts) == 15
    assert found.calibration_error.value < 0.05
    assert found.brier.interval[0] < found.brier.value < found.brier.interval[1]
    written = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert written["threshold_at_0.9"] < written["threshold_at_0.95"] < written["threshold_at_0.99"]
    low, high = written["threshold_at_0.95_interval"]
    assert low <= written["threshold_at_0.95"] <= high


def test_a_precision_that_no_answer_reaches() -> None:
    held = Held(answers(400).held_out_answers.probability, np.zeros(400, np.bool_))
    found = answer_reliability(held)  # type: ignore[arg-type]
    assert found is not None
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["threshold_at_0.99"] is None
    assert "99% right from a probability of none" in _caption(found)


def test_the_picture_says_the_numbers() -> None:
    found = answer_reliability(answers(2000))  # type: ignore[arg-type]
    assert found is not None
    caption = _caption(found)
    for measured in (found.calibration_error, found.brier):
        assert f"{measured.value:.3f} ({measured.interval[0]:.3f} to {measured.interval[1]:.3f})" in caption
    for precision, (threshold, _) in found.thresholds.items():
        assert f"{precision:.0%} right from a probability of {threshold:.3f}" in caption
    figure = reliability_figure(found)
    assert "2000 answers" in figure.axes[0].get_title(loc="left")
    assert len(png_bytes(figure, 50)) > 1000


def _caption(found: object) -> str:
    return str(reliability_figure(found).get_supxlabel())  # type: ignore[arg-type]


def test_a_map_that_has_held_nothing_out(unchanged_summer_map: Path) -> None:
    assert answer_reliability(Map.open(unchanged_summer_map)) is None


@pytest.mark.parametrize("name", ["threshold", "answers"])
def test_its_threshold_is_that_of_the_localizer(unchanged_three_map: Path, name: str) -> None:
    from everplace.mapping.localizer import Localizer

    map_ = Map.open(unchanged_three_map)
    found = answer_reliability(map_)
    assert found is not None
    if name == "answers":
        assert found.answers == len(map_.held_out_answers.probability)
    else:
        assert found.thresholds[0.9][0] == Localizer(map_).threshold(0.9)
