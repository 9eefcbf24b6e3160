from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.mapping.reliability import (
    BINS,
    brier_score,
    expected_calibration_error,
    reliability_bins,
    threshold_for,
    with_interval,
)

Answers = tuple[NDArray[np.float64], NDArray[np.bool_]]


@pytest.fixture(scope="module")
def kept() -> Answers:
    """Probabilities that keep their word."""
    rng = np.random.default_rng(0)
    p = rng.uniform(size=3000) ** 0.3
    return p, rng.uniform(size=3000) < p


def test_bins_hold_every_answer_once() -> None:
    p = np.array([0.0, 0.01, 0.5, 0.99, 1.0, 1.0])
    right = np.array([False, True, True, True, True, False])
    bins = reliability_bins(p, right)
    assert bins.counts.tolist() == [2, *[0] * 6, 1, *[0] * 6, 3]
    assert bins.probability[[0, 7, 14]].tolist() == pytest.approx([0.005, 0.5, 2.99 / 3])
    assert bins.right[[0, 7, 14]].tolist() == pytest.approx([0.5, 1, 2 / 3])
    for values in (bins.probability, bins.right, bins.low, bins.high):
        assert np.isnan(values[bins.counts == 0]).all()
        assert np.isfinite(values[bins.counts > 0]).all()


def test_intervals_of_bins_hold_what_is_true(kept: Answers) -> None:
    bins = reliability_bins(*kept)
    inside = (bins.low <= bins.probability) & (bins.probability <= bins.high)
    many = bins.counts > 50
    assert inside[many].mean() > 0.8
    assert ((bins.low <= bins.right) & (bins.right <= bins.high))[many].all()


def test_errors_of_known_answers() -> None:
    p, right = np.array([0.8, 0.8, 0.1, 0.1]), np.array([True, False, False, False])
    assert expected_calibration_error(p, right) == pytest.approx(0.5 * 0.3 + 0.5 * 0.1)
    assert brier_score(p, right) == pytest.approx((0.04 + 0.64 + 0.01 + 0.01) / 4)
    # An answer that counts three times is three answers.
    weights = np.array([3.0, 1, 1, 1])
    again = np.repeat(p, [3, 1, 1, 1]), np.repeat(right, [3, 1, 1, 1])
    for measure in (expected_calibration_error, brier_score):
        assert measure(p, right, weights) == pytest.approx(measure(*again))
        assert measure(p.reshape(2, 2), right.reshape(2, 2)) == pytest.approx(measure(p, right))
        assert np.isnan(measure(np.empty(0), np.empty(0, bool)))


def test_probabilities_that_keep_their_word_have_no_error(kept: Answers) -> None:
    p, right = kept
    assert expected_calibration_error(p, right) < 0.03
    assert expected_calibration_error(p**4, right) > 0.15
    assert brier_score(p, right) < brier_score(p**4, right)


def test_intervals_are_wider_where_neighbours_err_together() -> None:
    rng = np.random.default_rng(1)
    p = np.full(2400, 0.7)
    alone = rng.uniform(size=2400) < p
    together = np.repeat(rng.uniform(size=100) < 0.7, 24)
    widths = []
    for right in (alone, together):
        measured = with_interval(brier_score, p, right)
        low, high = measured.interval
        assert low < measured.value < high
        assert with_interval(brier_score, p, right) == measured  # the same at every call
        widths.append(high - low)
    assert widths[1] > 2.5 * widths[0]


def test_two_answers_a_frame_stay_together(kept: Answers) -> None:
    p, right = kept[0].reshape(-1, 2), kept[1].reshape(-1, 2)
    low, high = with_interval(expected_calibration_error, p, right, np.ones(p.shape)).interval
    assert 0 <= low < high < 0.1


def test_a_threshold_reaches_the_precision_and_no_more() -> None:
    p = np.linspace(0.5, 1, 501)
    right = p >= 0.6
    threshold, (low, high) = threshold_for(0.99, p, right)
    chosen = p >= threshold
    assert right[chosen].mean() >= 0.99
    assert right[p >= threshold - 0.002].mean() < 0.99
    assert low <= threshold <= high
    assert threshold_for(1.0, p, right)[0] == pytest.approx(0.6)


def test_a_threshold_of_answers_that_keep_their_word(kept: Answers) -> None:
    p, right = kept
    looser, strict = threshold_for(0.9, p, right), threshold_for(0.95, p, right)
    assert looser[0] < strict[0]
    for precision, (threshold, (low, high)) in ((0.9, looser), (0.95, strict)):
        assert right[p >= threshold].mean() >= precision
        assert low < threshold < high


@pytest.mark.parametrize(
    ("p", "right"),
    [
        (np.full(100, 0.9), np.arange(100) % 2 == 0),
        (np.full(30, 0.9), np.zeros(30, bool)),
        (np.empty(0), np.empty(0, bool)),
    ],
)
def test_a_precision_that_nothing_reaches_has_no_threshold(p: NDArray[np.float64], right: NDArray[np.bool_]) -> None:
    # Answers of one probability go together: the right ones of them cannot be picked.
    assert threshold_for(0.99, p, right) == (np.inf, (np.inf, np.inf))


def test_bins_without_answers() -> None:
    bins = reliability_bins(np.empty(0), np.empty(0, bool))
    assert bins.counts.tolist() == [0] * BINS
    assert np.isnan(bins.right).all()
