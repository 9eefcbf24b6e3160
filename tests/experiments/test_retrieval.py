"""Choosing a pair, its truth, and one method on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from everplace.data.route import open_route
from everplace.data.selection import Selection
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, RouteError
from everplace.experiments.retrieval import Matching, Truth, choose_pair, retrieve, true_matches


def test_a_pair_is_restricted_to_the_places_that_take_part(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection(slice(2, 7)))
    assert pair.query.name == "winter"
    assert pair.database.name == "summer"
    assert pair.query.stems == pair.database.stems == ("2", "3", "4", "5", "6")
    assert {traverse.name for traverse in chosen.traverses} == {"summer", "winter"}


def test_a_traverse_can_be_compared_with_itself(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "summer", "summer", Selection())
    result = retrieve(open_describer("hog"), pair, true_matches(chosen, pair, Truth())[0], Matching())
    assert result.scores.recall_at["1"] == 1.0


def test_an_unknown_condition_is_named(tiny_route: Path) -> None:
    with pytest.raises(RouteError, match="autumn"):
        choose_pair(open_route(tiny_route), "autumn", "summer", Selection())


def test_the_truth_comes_from_the_option_then_the_route_then_one_frame(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    assert true_matches(chosen, pair, Truth())[1] == Truth(1)
    assert true_matches(replace(chosen, tolerance=3), pair, Truth())[1] == Truth(3)
    matches, truth = true_matches(replace(chosen, tolerance=3), pair, Truth(0))
    assert truth == Truth(0)
    np.testing.assert_array_equal(matches, np.eye(12, dtype=bool))


def test_two_truths_at_once_are_refused(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    with pytest.raises(ConfigError, match="--radius"):
        true_matches(chosen, pair, Truth(1, 5.0))


def test_a_radius_uses_poses(tiny_route: Path) -> None:
    for traverse in ("summer", "winter"):
        rows = [f"{place},{10.0 * place},0,0" for place in range(12)]
        (tiny_route / traverse / "poses.csv").write_text("stem,x,y,heading\n" + "\n".join(rows) + "\n")
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    matches, truth = true_matches(chosen, pair, Truth(radius=15.0))
    assert str(truth) == "within 15 m"
    places = np.arange(12)
    np.testing.assert_array_equal(matches, np.abs(places[:, None] - places) <= 1)


def test_standardisation_and_sequences_change_the_match(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    truth = true_matches(chosen, pair, Truth())[0]
    plain = retrieve(open_describer("hog"), pair, truth, Matching())
    centred = retrieve(open_describer("hog"), pair, truth, Matching("centre", 3))
    assert np.abs(plain.similarity - centred.similarity).max() > 0.01
    # The first frame of a sequence has no past: its row is that of the centred match alone.
    alone = retrieve(open_describer("hog"), pair, truth, Matching("centre"))
    np.testing.assert_allclose(centred.similarity[0], alone.similarity[0])
    np.testing.assert_allclose(centred.similarity[2, 2], np.mean([alone.similarity[k, k] for k in range(3)]), rtol=1e-5)
    assert str(Matching("centre", 3)) == "standardised (centre), sequences of 3"


def test_descriptors_made_before_are_used_again(tiny_route: Path) -> None:
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    truth = true_matches(chosen, pair, Truth())[0]
    described: dict[str, object] = {}
    first = retrieve(open_describer("hog"), pair, truth, Matching(), described=described)  # type: ignore[arg-type]
    kept = dict(described)
    second = retrieve(open_describer("hog"), pair, truth, Matching(), described=described)  # type: ignore[arg-type]
    assert set(kept) == {"summer", "winter"}
    assert all(described[name] is kept[name] for name in kept)
    np.testing.assert_array_equal(first.similarity, second.similarity)


def test_stems_that_are_no_places_tell_no_truth_but_poses_do(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    for traverse in ("summer", "winter"):
        rows = [f"{place},{10.0 * place},0,0" for place in range(12)]
        (tiny_route / traverse / "poses.csv").write_text("stem,x,y,heading\n" + "\n".join(rows) + "\n")
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "summer", Selection())
    with pytest.raises(RouteError, match=r"are not aligned, as route.toml says \(aligned = false\), so nobody knows"):
        true_matches(chosen, pair, Truth())
    np.testing.assert_array_equal(true_matches(chosen, pair, Truth(radius=1.0))[0], np.eye(12, dtype=bool))
    chosen, pair = choose_pair(open_route(tiny_route), "winter", "winter", Selection())
    np.testing.assert_array_equal(true_matches(chosen, pair, Truth(0))[0], np.eye(12, dtype=bool))
