"""The model of a drive: its probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.sequences.hidden_markov import MODELS, transitions

from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences.route_model import RouteModel, checked_scores


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("places", [1, 2, 5])
def test_something_happens_with_certainty(model: RouteModel, places: int) -> None:
    T = transitions(model, places)
    np.testing.assert_allclose(T.sum(axis=1), 1)
    np.testing.assert_allclose(model.exits(places).ravel(), T[:-1, -1])


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"turn": 0.0}, "turn"),
        ({"leave": 1.5}, "leave"),
        ({"enter": float("nan")}, "enter"),
        ({"jump": 0.6, "leave": 0.4}, "jump and leave"),
        ({"steps": (0.5, 0.4)}, "steps"),
        ({"steps": ()}, "steps"),
        ({"steps": (1.5, -0.5)}, "steps"),
        ({"separation": -1.0}, "separation"),
        ({"doubt": -0.1}, "doubt"),
        ({"even": (0.5, 0.4)}, "even"),
        ({"pace": 0.0}, "pace"),
        ({"pace": 0.6, "turn": 0.4}, "pace and turn"),
        ({"evenly": 1.0}, "evenly"),
        ({"spread": -0.1}, "spread"),
        ({"stand": 0.0}, "stand"),
        ({"blank": 1.0}, "blank"),
        ({"repeat": 0.0}, "repeat"),
        ({"beside": 1.5}, "beside"),
        ({"forward": 1.0}, "forward"),
    ],
)
def test_what_is_no_probability_is_refused_by_name(wrong: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        RouteModel(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("S", [np.ones(3), np.ones((0, 3)), np.ones((2, 0)), np.array([["a"]])])
def test_what_is_no_matrix_of_numbers_is_refused(S: NDArray[np.float64]) -> None:
    with pytest.raises(DescriptorsError, match="no traverse"):
        checked_scores(S)
