"""FAB-MAP's probabilities against sums over every state of the world and every observation."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.fabmap.chow_liu import ChowLiuTree
from everplace.fabmap.place_likelihood import observe, sampled_new_place

quick = settings(max_examples=15, deadline=None)

WORDS = 4
STATES = np.array(list(product((False, True), repeat=WORDS)))


def random_tree(seed: int) -> ChowLiuTree:
    rng = np.random.default_rng(seed)
    order = rng.permutation(WORDS)
    parent = np.empty(WORDS, np.int64)
    parent[order[0]] = order[0]
    for index in range(1, WORDS):
        parent[order[index]] = order[rng.integers(index)]
    present, after_present, after_absent = rng.uniform(0.02, 0.98, (3, WORDS))
    after_present[order[0]] = after_absent[order[0]] = present[order[0]]
    return ChowLiuTree(parent, present, after_present, after_absent)


def enumerated(tree: ChowLiuTree, z: NDArray[np.bool_], exists: list[float]) -> float:
    """p(Z) as a sum over all 2^W worlds e; `exists` holds p(e_q = 1)."""
    total = 0.0
    for e in product((0, 1), repeat=WORDS):
        world = math.prod(p if there else 1 - p for p, there in zip(exists, e, strict=True))
        seen = 1.0
        for q in range(WORDS):
            fires = 0.39 if e[q] else 0.0
            after = (tree.after_present if z[tree.parent[q]] else tree.after_absent)[q]
            # p(z_q | e_q, z_parent) for both values of z_q: p(z|e) p(z|parent) / p(z), normalised.
            yes = fires * after / tree.present[q]
            no = (1 - fires) * (1 - after) / (1 - tree.present[q])
            seen *= (yes if z[q] else no) / (yes + no)
        total += world * seen
    return total


def existence(tree: ChowLiuTree, place: NDArray[np.bool_]) -> list[float]:
    """Bayes' rule, word by word."""
    found = []
    for q in range(WORDS):
        there, nothing = (0.39, 0.0) if place[q] else (0.61, 1.0)
        found.append(there * tree.present[q] / (there * tree.present[q] + nothing * (1 - tree.present[q])))
    return found


@quick
@given(st.integers(0, 10**6))
def test_the_affine_form_is_the_sum_over_all_worlds(seed: int) -> None:
    tree = random_tree(seed)
    likelihood = np.exp(observe(tree, STATES).log_likelihood(STATES))
    slow = [[enumerated(tree, z, existence(tree, place)) for place in STATES] for z in STATES]
    np.testing.assert_allclose(likelihood, slow, rtol=1e-9)


@quick
@given(st.integers(0, 10**6))
def test_all_observations_of_a_place_make_up_certainty(seed: int) -> None:
    observations = observe(random_tree(seed), STATES)
    np.testing.assert_allclose(np.exp(observations.log_likelihood(STATES)).sum(axis=0), 1.0)
    assert np.exp(observations.new_place).sum() == pytest.approx(1.0)


@quick
@given(st.integers(0, 10**6))
def test_at_a_new_place_every_feature_has_its_prior(seed: int) -> None:
    tree = random_tree(seed)
    slow = [enumerated(tree, z, tree.present.tolist()) for z in STATES]
    np.testing.assert_allclose(np.exp(observe(tree, STATES).new_place), slow, rtol=1e-9)


def test_sampling_is_the_mean_over_the_samples() -> None:
    tree = random_tree(1)
    sample = STATES[[3, 3, 8, 15]]
    slow = [np.mean([enumerated(tree, z, existence(tree, place)) for place in sample]) for z in STATES]
    np.testing.assert_allclose(np.exp(sampled_new_place(observe(tree, STATES), sample)), slow, rtol=1e-9)


def test_without_dependence_it_is_naive_bayes_by_hand() -> None:
    same = np.array([0.2, 0.5])
    tree = ChowLiuTree(np.array([0, 0]), same, same, same)
    observations = observe(tree, np.array([[True, False]]))
    # Place with word 0 only. Word 0 exists for sure: 0.39. Word 1 exists with 0.61·0.5 / (0.61·0.5 + 0.5).
    exists = 0.61 * 0.5 / (0.61 * 0.5 + 0.5)
    expected = 0.39 * (exists * 0.61 + (1 - exists))
    assert float(observations.log_likelihood(np.array([[True, False]]))[0, 0]) == pytest.approx(math.log(expected))
    assert float(observations.new_place[0]) == pytest.approx(math.log(0.2 * 0.39 * (0.5 * 0.61 + 0.5)))


def test_observations_without_any_word_and_with_all_of_them_stay_finite() -> None:
    rng = np.random.default_rng(0)
    words = 2000
    present = np.where(rng.random(words) < 0.5, 0.01, 0.99)
    tree = ChowLiuTree(np.zeros(words, np.int64), present, present[::-1].copy(), present)
    extreme = np.array([np.zeros(words), np.ones(words)], np.bool_)
    observations = observe(tree, extreme)
    for values in (observations.log_likelihood(extreme), observations.new_place, observations.coefficients):
        assert np.isfinite(values).all()
    assert np.isfinite(sampled_new_place(observations, extreme)).all()
