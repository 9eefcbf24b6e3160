"""The ablation of adapting: its rows differ by what they change, and nothing stays changed."""

from __future__ import annotations

import numpy as np
from studies.ablation import VARIANTS, rows, with_stretches

from everplace.adaptation import route_adaptation
from everplace.adaptation.moments import Moments
from everplace.adaptation.prior import Prior

F, PLACES = 30, 120
RNG = np.random.default_rng(0)
MAP = RNG.normal(size=(PLACES, F)).astype(np.float32)
LATER = (MAP + RNG.normal(size=(PLACES, F)) * np.linspace(0.2, 2.5, F)).astype(np.float32)
LIGHT = Moments.of(RNG.normal(size=(200, F)) * np.linspace(2, 0.5, F))
PRIOR = Prior.of(np.diag(np.linspace(0.1, 3, F)), "hog16", {})


def test_a_stretch_is_one_more_change_of_what_its_pairs_weigh() -> None:
    weights = np.linspace(0.5, 1, 60)
    changes, told = with_stretches(MAP[:60], weights, 3.0)
    np.testing.assert_array_equal(changes[:60], MAP[:60])
    np.testing.assert_allclose(changes[60:], [MAP[:24].mean(0), MAP[24:48].mean(0)], rtol=1e-5)
    np.testing.assert_allclose(told, [*weights, 3 * weights[:24].sum(), 3 * weights[24:48].sum()])
    none, nothing = with_stretches(MAP[:0], weights[:0], 3.0)
    assert (none.shape, nothing.shape) == ((0, F), (0,))


def test_every_variant_is_a_row_and_changes_what_it_says() -> None:
    before = (route_adaptation.RIDGE, route_adaptation.LIGHT_WEIGHT, route_adaptation.PRIOR_WEIGHT)
    found = dict(rows((MAP, LATER), LIGHT, PRIOR, 8, taught=60, tested=70))
    assert list(found) == list(VARIANTS)
    assert all(len(cells) == 4 for cells in found.values())
    usual = found["as it is"]
    for what in ("ridge 4", "other light, weight 2"):
        assert found[what] != usual, what
    for what in ("prior counts as 50 pairs", "prior counts as 800 pairs"):
        assert found[what][0] == usual[0], "without a prior its weight is nothing"
        assert found[what][1] != usual[1]
    assert [what for what, cells in found.items() if "" in cells] == ["no other light"]
    assert found["stretches, weight 20"][:2] == usual[:2], "one drive has no pairs"
    assert before == (route_adaptation.RIDGE, route_adaptation.LIGHT_WEIGHT, route_adaptation.PRIOR_WEIGHT)
