"""The posterior against sums in plain Python, whole and in blocks, and where it is almost certain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, DescriptorsError
from everplace.fabmap import place_posterior as module
from everplace.match import similarity as similarities
from everplace.match.new_place import new_place_probability, new_place_summary
from everplace.match.similarity import similarity, similarity_blocks, top_k
from everplace.match.standardise import standardise

quick = settings(max_examples=20, deadline=None)

WORDS = 6


def frames(count: int, seed: int, scale: float = 3.0, name: str = "f") -> Descriptors:
    """Words of a place, coefficients of an observation, and its log-likelihood at a new place."""
    rng = np.random.default_rng(seed)
    places = rng.random((count, WORDS)) < 0.5
    values = np.concatenate([places, rng.normal(0, scale, (count, WORDS + 1))], axis=1).astype(np.float32)
    return Descriptors(values, tuple(f"{name}{i}" for i in range(count)), "fabmap", "place-posterior")


def slow(query: Descriptors, database: Descriptors) -> tuple[list[list[float]], list[float]]:
    """Probabilities of the places and of a new one, in double precision."""
    rows, new = [], []
    for q in query.values.astype(float):
        likelihood = [math.exp(float(q[WORDS : 2 * WORDS] @ d[:WORDS])) for d in database.values.astype(float)]
        fresh = math.exp(float(q[-1]))
        total = sum(likelihood) + fresh
        rows.append([one / total for one in likelihood])
        new.append(fresh / total)
    return rows, new


@quick
@given(st.integers(0, 10**6))
def test_it_is_bayes_rule_over_all_places_and_a_new_one(seed: int) -> None:
    query, database = frames(4, seed), frames(7, seed + 1)
    places, new = slow(query, database)
    S = similarity(query, database)
    assert S.dtype == np.float32
    np.testing.assert_allclose(np.exp(S), places, rtol=1e-4)
    np.testing.assert_allclose(new_place_probability(query, database), new, rtol=1e-4)
    np.testing.assert_allclose(np.exp(S).sum(axis=1) + new_place_probability(query, database), 1.0, rtol=1e-5)
    assert (S <= 0).all()


@pytest.mark.parametrize("k", [1, 3, 40])
def test_blocks_and_the_best_k_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch, k: int) -> None:
    query, database = frames(11, 1), frames(25, 2)
    S, new = similarity(query, database), new_place_probability(query, database)
    assert np.allclose(np.vstack([block for _, block in similarity_blocks(query, database, block=4)]), S, atol=1e-5)
    monkeypatch.setattr(similarities, "_BLOCK", 4)
    monkeypatch.setattr(similarities, "_DATABASE_BLOCK", 6)
    monkeypatch.setattr(module, "_BLOCK", 3)
    monkeypatch.setattr(module, "_DATABASE_BLOCK", 7)
    _, scores = top_k(query, database, k)
    np.testing.assert_allclose(scores, np.sort(S, axis=1)[:, ::-1][:, :k], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(new_place_probability(query, database), new, rtol=1e-4)


def test_a_surer_match_does_not_tie_with_a_sure_one() -> None:
    database = frames(2, 0)
    database = replace(database, values=np.eye(2, 2 * WORDS + 1, dtype=np.float32))
    values = np.zeros((2, 2 * WORDS + 1), np.float32)
    values[0, WORDS], values[1, WORDS] = 40.0, 60.0  # log-likelihood at the first place; 0 at the other and a new one
    S = similarity(replace(frames(2, 0), values=values), database)
    assert S[:, 0].tolist() == pytest.approx([-2 * math.exp(-40), -2 * math.exp(-60)])
    assert S[:, 1].tolist() == pytest.approx([-40.0, -60.0])
    assert S[1, 0] > S[0, 0]


def test_a_query_like_nothing_known_is_a_new_place() -> None:
    query, database = frames(3, 0), frames(5, 1)
    values = query.values.copy()
    values[:, -1] = [500.0, -500.0, 500.0]
    query = replace(query, values=values)
    np.testing.assert_allclose(new_place_probability(query, database), [1, 0, 1], atol=1e-6)
    assert new_place_summary(query, database) == {"mean_probability": pytest.approx(2 / 3), "above_half": 2}
    assert np.isfinite(similarity(query, database)).all()


def test_other_methods_know_no_new_place() -> None:
    d = Descriptors(np.ones((2, 3), np.float32), ("a", "b"), "hog")
    assert new_place_summary(d, d) is None
    with pytest.raises(DescriptorsError, match="descriptors of hog and hog are no words of FAB-MAP"):
        new_place_probability(d, d)


@pytest.mark.parametrize("dimension", [2 * WORDS, 1])
def test_numbers_that_cannot_be_words_are_refused(dimension: int) -> None:
    d = replace(frames(3, 0), values=frames(3, 0).values[:, :dimension])
    with pytest.raises(DescriptorsError, match=f"of {dimension} and {dimension} numbers are no words"):
        similarity(d, d)


def test_runs_are_not_mixed() -> None:
    one = replace(frames(3, 0), settings={"weights": "a"})
    with pytest.raises(DescriptorsError, match="setting weights of the query is a and of the database b"):
        similarity(one, replace(one, settings={"weights": "b"}))


def test_words_cannot_be_standardised() -> None:
    with pytest.raises(ConfigError, match="`standardise` does not apply to the words of fabmap"):
        standardise(frames(3, 0), "centre")
