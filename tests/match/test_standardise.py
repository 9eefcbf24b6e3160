"""Standardisation against the formula, and where there is nothing to divide by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError
from everplace.match import standardise as module
from everplace.match.standardise import standardise


def descriptors(values: NDArray[Any], **others: Any) -> Descriptors:
    names = tuple(str(i) for i in range(len(values)))
    return Descriptors(values.astype(np.float32), names, "test", **others)


def test_centre_and_full_are_the_formulas() -> None:
    values = np.random.default_rng(0).normal(5, 3, (50, 4)).astype(np.float32)
    d = descriptors(values, settings={"cell": 8})
    centred, full = standardise(d, "centre"), standardise(d, "full")
    assert np.allclose(centred.values, values - values.mean(axis=0), atol=1e-5)
    assert np.allclose(full.values, (values - values.mean(axis=0)) / values.std(axis=0), atol=1e-5)
    assert centred.settings == {"cell": 8, "standardise": "centre"}
    assert full.settings == {"cell": 8, "standardise": "full"}
    assert (d.values == values).all()
    assert d.settings == {"cell": 8}


def test_a_dimension_that_does_not_vary_becomes_zero() -> None:
    values = np.full((1000, 3), 0.1, np.float32)
    values[:, 1] = np.arange(1000)
    full = standardise(descriptors(values), "full").values
    assert (full[:, [0, 2]] == 0).all()
    assert full[:, 1].std() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("how", ["centre", "full"])
def test_one_frame_becomes_zero(how: Any) -> None:
    assert standardise(descriptors(np.array([[1.5, -2.0]])), how).values.tolist() == [[0, 0]]


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    d = descriptors(np.random.default_rng(0).random((23, 3)))
    whole = standardise(d, "full").values
    monkeypatch.setattr(module, "_ROWS", 5)
    assert np.allclose(standardise(d, "full").values, whole, rtol=1e-6)


def test_another_word_is_refused() -> None:
    with pytest.raises(ConfigError, match="the standardisation 'center' is not known; choose centre, full or running"):
        standardise(descriptors(np.ones((2, 2))), "center")  # type: ignore[arg-type]


def test_running_subtracts_the_mean_so_far_which_starts_as_the_maps() -> None:
    rng = np.random.default_rng(3)
    values, start = rng.normal(size=(1500, 4)).astype(np.float32), rng.normal(size=4)
    drive = Descriptors(values, tuple(map(str, range(1500))), "m")
    found = standardise(drive, "running", start=start).values
    for row in (0, 1, 700, 1023, 1024, 1499):
        seen = values[: row + 1].astype(float)
        wanted = values[row] - (10 * start + seen.sum(axis=0)) / (10 + row + 1)
        np.testing.assert_allclose(found[row], wanted, atol=1e-6)


def test_running_centres_a_map_as_a_whole() -> None:
    values = np.random.default_rng(4).normal(1.0, 1.0, (50, 4)).astype(np.float32)
    map_ = Descriptors(values, tuple(map(str, range(50))), "m")
    np.testing.assert_array_equal(standardise(map_, "running").values, standardise(map_, "centre").values)
