"""What a frame's scores say of the places."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.sequences.evidence import likelihood_ratios, news, repeat_likelihoods, standardised
from everplace.sequences.route_model import RouteModel


def ratios_of(scores: NDArray[np.float64], model: RouteModel) -> NDArray[np.float64]:
    return likelihood_ratios(standardised(scores), model)


def test_the_ratio_is_that_of_the_place_to_a_random_place() -> None:
    from scipy.stats import norm, zscore

    S = np.random.default_rng(1).random((3, 40))
    z = zscore(S, axis=1)
    # The true place scores N(d, 1) with d of N(2, 0.6²).
    fit = norm.pdf(z, 2.0, np.hypot(1, 0.6)) / norm.pdf(z)
    likelihoods = 0.85 * fit / fit.mean(axis=1, keepdims=True) + 0.15
    says = np.log(np.square(likelihoods).mean(axis=1, keepdims=True))
    np.testing.assert_allclose(ratios_of(S, RouteModel()), likelihoods * np.exp(-0.3 * says))


def test_no_frame_speaks_against_a_place_by_more_than_the_share_of_outliers() -> None:
    S = np.zeros((1, 500))
    S[0, 7] = 1.0
    ratios = ratios_of(S, RouteModel(doubt=0.0))[0]
    assert ratios.argmax() == 7
    assert ratios.min() >= RouteModel().outlier


def test_a_place_that_fits_worse_is_never_likelier() -> None:
    z = np.linspace(-30, 30, 601)
    assert (np.diff(likelihood_ratios(z, RouteModel(spread=2.0))) >= 0).all()


@pytest.mark.parametrize("share", [0.9, 0.99])
def test_what_the_last_frame_said_is_no_news(share: float) -> None:
    rng = np.random.default_rng(0)
    veil, one, other = rng.normal(size=(3, 20_000))
    before, now = (standardised(np.sqrt(share) * veil + np.sqrt(1 - share) * own) for own in (one, other))
    fresh = news(now, before, np.array((1 - share) / 2))
    assert abs(np.corrcoef(fresh, before)[0, 1]) < 0.02
    assert fresh.std() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("change", [0.5, 1.0, np.inf])
def test_a_frame_that_changed_is_all_news(change: float) -> None:
    now, before = np.random.default_rng(1).normal(size=(2, 50))
    np.testing.assert_array_equal(news(now, before, np.array(change)), now)


def test_places_unknown_before_are_not_corrected() -> None:
    now, before = np.random.default_rng(2).normal(size=(2, 9))
    before[3] = np.nan
    fresh = news(now, before, np.array(0.2))
    assert np.isfinite(fresh).all()
    assert fresh[3] == pytest.approx(now[3] / 0.8)


def test_a_frame_that_shows_its_place_comes_again_where_the_robot_stands() -> None:
    z = np.zeros(40)
    z[20] = 5.0
    stands, goes = repeat_likelihoods(likelihood_ratios(z, RouteModel()), RouteModel())
    assert stands.shape == (1, 40)
    assert goes.shape == (3, 40)
    assert (stands[0, 20] > 20 * goes[:, 20]).all()
    assert (goes[:, 1:19] > stands[0, 1:19]).all()


def test_places_that_look_alike_are_driven_through() -> None:
    z = np.zeros(40)
    z[20:25] = 4.0
    stands, goes = repeat_likelihoods(likelihood_ratios(z, RouteModel()), RouteModel())
    assert (goes[:2, 20:24] > 2 * stands[0, 20:24]).all()
    assert (goes[2, 21:25] > 2 * stands[0, 21:25]).all()
    assert (stands[0, 24] > 5 * goes[:2, 24]).all()
    assert stands[0, 20] > 5 * goes[2, 20]


@given(arrays(np.float64, (2, 7), elements=st.one_of(st.floats(-1e6, 1e6), st.just(np.nan))))
def test_one_frame_says_nothing_of_whether_the_robot_is_on_the_map(S: NDArray[np.float64]) -> None:
    ratios = ratios_of(S, RouteModel(doubt=0.0))
    np.testing.assert_allclose(ratios.mean(axis=1), 1)
    doubted = ratios_of(S, RouteModel(doubt=0.5))
    np.testing.assert_allclose(doubted, ratios / np.sqrt(np.square(ratios).mean(axis=1, keepdims=True)))


@settings(max_examples=40, deadline=None)
@given(
    arrays(np.float64, (3, 6), elements=st.integers(-50, 50).map(float)),
    st.floats(1e-3, 1e3),
    st.floats(-1e3, 1e3),
)
def test_shift_and_scale_of_the_scores_do_not_matter(S: NDArray[np.float64], scale: float, shift: float) -> None:
    model = RouteModel()
    np.testing.assert_allclose(ratios_of(S * scale + shift, model), ratios_of(S, model), rtol=1e-6)


def test_unknown_scores_say_nothing_and_do_not_disturb_the_others() -> None:
    S = np.random.default_rng(2).random((2, 9))
    gappy = np.insert(S, 4, np.nan, axis=1)
    ratios = ratios_of(gappy, RouteModel())
    np.testing.assert_allclose(np.delete(ratios, 4, axis=1), ratios_of(S, RouteModel()), rtol=0.1)
    exact = RouteModel(doubt=0.0)
    ratios = ratios_of(gappy, exact)
    np.testing.assert_allclose(np.delete(ratios, 4, axis=1), ratios_of(S, exact))
    np.testing.assert_allclose(ratios[:, 4], 1)


def test_infinite_scores_are_the_strongest_statements() -> None:
    ratios = ratios_of(np.array([0.1, 0.2, 0.3, np.inf, -np.inf]), RouteModel())
    assert ratios[3] == ratios.max() == pytest.approx(5 * ratios.mean(), rel=0.15)
    assert 0 < ratios[4] == ratios.min() < 0.15


@pytest.mark.parametrize("row", [[3.0, 3.0, 3.0], [0.1] * 7, [np.nan] * 3, [np.nan, 5.0, np.nan], [np.inf, 1.0, 1.0]])
def test_a_frame_without_differences_says_nothing(row: list[float]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (ratios_of(np.array(row), RouteModel()) == 1).all()
