from __future__ import annotations

import numpy as np
import pytest

from everplace.mapping.standard_scores import ScoreMoments, bent_scores, log_sum, near_values, standard_scores

RNG = np.random.default_rng(0)


def test_scores_get_mean_0_and_deviation_1_where_they_are_known() -> None:
    S = RNG.normal(3, 2, (4, 50))
    S[0, :20] = np.nan
    S[1, 5] = np.inf
    z, log_places = standard_scores(S)
    assert np.exp(log_places) == pytest.approx([30, 49, 50, 50])
    assert np.nanmean(z, axis=1) == pytest.approx(np.zeros(4), abs=1e-12)
    assert np.nanstd(z, axis=1) == pytest.approx(np.ones(4))
    assert np.isnan(z[0, :20]).all()
    assert np.isnan(z[1, 5])


def test_moments_of_the_whole_map_stand_for_scores_that_were_not_found() -> None:
    z, log_places = standard_scores(np.array([[0.9, np.nan]]), ScoreMoments(np.array([0.1]), np.array([0.2]), 1000))
    assert z[0, 0] == pytest.approx(4)
    assert log_places == pytest.approx([np.log(1000)])


@pytest.mark.parametrize("scores", [[1.0, 1.0], [1e9, 1e9 + 1e-7], [np.nan, 5.0]])
def test_scores_that_do_not_vary_are_0(scores: list[float]) -> None:
    z, _ = standard_scores(np.array(scores))
    assert np.nan_to_num(z).tolist() == [0, 0]


def test_log_sums_with_their_slope() -> None:
    z = RNG.normal(size=(5, 30))
    z[2, 7:] = np.nan
    value, slope = log_sum(z, 2.0)
    assert value == pytest.approx(np.log(np.nansum(np.exp(2 * z), axis=1)))
    above, below = (log_sum(z, 2.0 + step)[0] for step in (1e-6, -1e-6))
    assert slope == pytest.approx((above - below) / 2e-6, abs=1e-6)
    nothing, no_slope = log_sum(np.full((1, 3), np.nan), 2.0)
    assert nothing.tolist() == [-np.inf]
    assert no_slope.tolist() == [0]
    assert log_sum(np.array([[1000.0, 999.0]]), 50.0)[0] == pytest.approx([50_000])


def test_scores_above_the_mean_are_bent_upwards_and_keep_their_order() -> None:
    S = RNG.normal(size=(3, 40))
    S[0, 3] = np.nan
    z, _ = standard_scores(S)
    bent, log_places = bent_scores(S)
    assert np.array_equal(log_places, standard_scores(S)[1])
    assert np.array_equal(bent[z <= 0], z[z <= 0])
    assert bent[z > 0] == pytest.approx(z[z > 0] + 0.12 * z[z > 0] ** 2)
    assert np.isnan(bent[0, 3])
    assert np.array_equal(np.argsort(bent, axis=1), np.argsort(S, axis=1))


def test_neighbours_beyond_the_ends_are_said_to_be_beyond() -> None:
    values = np.arange(5.0)
    assert near_values(np.stack([values, values]), np.array([0, 3]), 2, -1).tolist() == [
        [-1, -1, 0, 1, 2],
        [1, 2, 3, 4, -1],
    ]
    assert near_values(values, np.array(4), 1, -1).tolist() == [3, 4, -1]
    assert near_values(values, np.array(2), 0, -1).tolist() == [2]
