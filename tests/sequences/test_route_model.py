"""The model of a drive: its probabilities, and what a frame's scores say."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from tests.sequences.hidden_markov import MODELS, transitions

from everplace.errors import ConfigError, DescriptorsError
from everplace.sequences.route_model import RouteModel, checked_scores, likelihood_ratios


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
        ({"repeat": 0.0}, "repeat"),
        ({"beside": 1.5}, "beside"),
        ({"forward": 1.0}, "forward"),
    ],
)
def test_what_is_no_probability_is_refused_by_name(wrong: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        RouteModel(**wrong)  # type: ignore[arg-type]


def test_the_ratio_is_that_of_the_place_to_a_random_place() -> None:
    from scipy.stats import norm, zscore

    S = np.random.default_rng(1).random((3, 40))
    z = zscore(S, axis=1)
    likelihoods = 0.8 * norm.pdf(z, 2.5) / norm.pdf(z) + 0.2
    expected = likelihoods / likelihoods.mean(axis=1, keepdims=True) * np.exp(-0.75)
    np.testing.assert_allclose(likelihood_ratios(S, RouteModel()), expected)


@given(arrays(np.float64, (2, 7), elements=st.one_of(st.floats(-1e6, 1e6), st.just(np.nan))))
def test_one_frame_says_nothing_of_whether_the_robot_is_on_the_map(S: NDArray[np.float64]) -> None:
    ratios = likelihood_ratios(S, RouteModel(doubt=0.0))
    np.testing.assert_allclose(ratios.mean(axis=1), 1)
    doubted = likelihood_ratios(S, RouteModel(doubt=0.5))
    says = (doubted != 1).any(axis=1)
    np.testing.assert_allclose(doubted[says], ratios[says] * np.exp(-0.5))


@settings(max_examples=40, deadline=None)
@given(
    arrays(np.float64, (3, 6), elements=st.integers(-50, 50).map(float)),
    st.floats(1e-3, 1e3),
    st.floats(-1e3, 1e3),
)
def test_shift_and_scale_of_the_scores_do_not_matter(S: NDArray[np.float64], scale: float, shift: float) -> None:
    model = RouteModel()
    np.testing.assert_allclose(likelihood_ratios(S * scale + shift, model), likelihood_ratios(S, model), rtol=1e-6)


def test_unknown_scores_say_nothing_and_do_not_disturb_the_others() -> None:
    S = np.random.default_rng(2).random((2, 9))
    gappy = np.insert(S, 4, np.nan, axis=1)
    ratios = likelihood_ratios(gappy, RouteModel())
    np.testing.assert_allclose(np.delete(ratios, 4, axis=1), likelihood_ratios(S, RouteModel()))
    assert (ratios[:, 4] == np.exp(-RouteModel().doubt)).all()


def test_infinite_scores_are_the_strongest_statements() -> None:
    ratios = likelihood_ratios(np.array([0.1, 0.2, 0.3, np.inf, -np.inf]), RouteModel())
    assert ratios[3] == pytest.approx(5 * np.exp(-0.75))
    assert 0 < ratios[4] == ratios.min() < 1e-20


@pytest.mark.parametrize("row", [[3.0, 3.0, 3.0], [0.1] * 7, [np.nan] * 3, [np.nan, 5.0, np.nan], [np.inf, 1.0, 1.0]])
def test_a_frame_without_differences_says_nothing(row: list[float]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (likelihood_ratios(np.array(row), RouteModel()) == 1).all()


@pytest.mark.parametrize("S", [np.ones(3), np.ones((0, 3)), np.ones((2, 0)), np.array([["a"]])])
def test_what_is_no_matrix_of_numbers_is_refused(S: NDArray[np.float64]) -> None:
    with pytest.raises(DescriptorsError, match="no traverse"):
        checked_scores(S)
