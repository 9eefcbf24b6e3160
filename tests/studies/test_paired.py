"""Paired differences of recall against what is known of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm
from studies.paired import STRETCH, Found, paired_difference

PLACES = np.arange(60 * STRETCH)


def found(right: np.ndarray, place: np.ndarray = PLACES) -> Found:
    return Found(place, right)


def test_what_finds_the_same_differs_by_nothing() -> None:
    right = np.random.default_rng(0).random(len(PLACES)) < 0.9
    same = paired_difference(found(right), [found(right), found(right)])
    assert same == {"difference": 0.0, "low": 0.0, "high": 0.0, "no worse": 1.0}


def test_the_interval_is_that_of_the_mean_over_stretches() -> None:
    rng = np.random.default_rng(1)
    lost = rng.integers(0, 5, 60)  # places lost in each stretch
    right = lost[PLACES // STRETCH] <= (PLACES % STRETCH)
    result = paired_difference(found(np.ones(len(PLACES), bool)), [found(right)])
    share = lost / STRETCH
    width = norm.ppf(0.975) * share.std() / np.sqrt(60)
    assert result["difference"] == pytest.approx(-share.mean())
    assert result["low"] == pytest.approx(-share.mean() - width, abs=0.003)
    assert result["high"] == pytest.approx(-share.mean() + width, abs=0.003)
    assert result["no worse"] == 0.0


def test_drives_count_alike_however_long_they_are() -> None:
    recorded = found(PLACES >= 1)
    short, long = PLACES[::10], PLACES.repeat(3)
    drives = [found(np.ones(len(short), bool), short), found(long >= 6, long)]
    result = paired_difference(recorded, drives)
    assert result["difference"] == pytest.approx((1 + np.mean(long >= 6)) / 2 - np.mean(PLACES >= 1))
    assert result["no worse"] == 0.5
    assert result["low"] <= result["difference"] <= result["high"]
    none = paired_difference(found(PLACES >= 0), [found(short >= 0, short), found(long < 0, long)])
    assert [none["low"], none["difference"], none["high"]] == pytest.approx([-0.5] * 3)
