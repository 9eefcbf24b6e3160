"""The tree against all trees there are and against pgmpy; its probabilities against counting."""

from __future__ import annotations

import math
import warnings
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.fabmap.chow_liu import ChowLiuTree, WordCounts, learn_tree, mutual_information

quick = settings(max_examples=25, deadline=None)


def counted(words: NDArray[np.bool_]) -> WordCounts:
    counts = WordCounts.none(words.shape[1])
    counts.add(words)
    return counts


def dependent_words(frames: int, words: int, seed: int) -> NDArray[np.bool_]:
    """Words that follow each other with different strength, so that no two pairs tie."""
    rng = np.random.default_rng(seed)
    hidden = rng.random((frames, words)) < rng.uniform(0.2, 0.6, words)
    for word in range(1, words):
        copied = rng.random(frames) < rng.uniform(0.1, 0.9)
        hidden[copied, word] = hidden[copied, rng.integers(word)]
    return hidden


def slow_information(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    total = 0.0
    for i, j in product((False, True), repeat=2):
        both, one, other = np.mean((a == i) & (b == j)), np.mean(a == i), np.mean(b == j)
        total += both * math.log(both / (one * other)) if both else 0.0
    return total


def all_trees(words: int) -> list[list[tuple[int, int]]]:
    """Every spanning tree, from its Prüfer sequence."""
    trees = []
    for sequence in product(range(words), repeat=words - 2):
        degree = [1 + sequence.count(word) for word in range(words)]
        edges = []
        for word in sequence:
            leaf = degree.index(1)
            edges.append((leaf, word))
            degree[leaf] -= 1
            degree[word] -= 1
        first, last = (word for word in range(words) if degree[word] == 1)
        trees.append([*edges, (first, last)])
    return trees


def edges_of(tree: ChowLiuTree) -> set[frozenset[int]]:
    return {frozenset((word, int(parent))) for word, parent in enumerate(tree.parent) if word != parent}


@quick
@given(st.integers(0, 10**6), st.integers(1, 30))
def test_information_is_that_of_the_formula(seed: int, frames: int) -> None:
    words = np.random.default_rng(seed).random((frames, 4)) < 0.4
    information = mutual_information(counted(words))
    slow = [[slow_information(words[:, i], words[:, j]) for j in range(4)] for i in range(4)]
    np.testing.assert_allclose(information, slow, atol=1e-12)
    assert (information >= 0).all()


@quick
@given(st.integers(0, 10**6))
def test_no_tree_carries_more_information(seed: int) -> None:
    words = np.random.default_rng(seed).random((12, 5)) < 0.5  # few frames: ties, and words without any information
    information = mutual_information(counted(words))
    tree = learn_tree(counted(words))
    edges = edges_of(tree)
    assert len(edges) == 4
    best = max(sum(information[a, b] for a, b in some) for some in all_trees(5))
    assert sum(information[tuple(edge)] for edge in edges) == pytest.approx(best, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_edges_are_those_that_pgmpy_finds(seed: int) -> None:
    words = dependent_words(400, 9, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pgmpy speaks of what it will rename
        estimators = pytest.importorskip("pgmpy.estimators", reason="pgmpy, the oracle, is not installed")
        frame = pytest.importorskip("pandas").DataFrame(words.astype(int))
        found = estimators.TreeSearch(frame, root_node=0, n_jobs=1).estimate(
            estimator_type="chow-liu", show_progress=False
        )
    assert edges_of(learn_tree(counted(words))) == {frozenset(edge) for edge in found.edges()}


def test_probabilities_are_smoothed_frequencies() -> None:
    words = dependent_words(200, 6, 3)
    tree = learn_tree(counted(words))
    roots = [word for word, parent in enumerate(tree.parent) if word == parent]
    assert len(roots) == 1
    for word, parent in enumerate(tree.parent):
        assert tree.present[word] == pytest.approx(0.98 * words[:, word].mean() + 0.01)
        for after, seen in ((tree.after_present, True), (tree.after_absent, False)):
            frames = words[words[:, parent] == seen, word]
            expected = tree.present[word] if word == parent else 0.98 * frames.mean() + 0.01
            assert after[word] == pytest.approx(expected)
    np.testing.assert_array_equal(
        tree.conditional(words[:3]),
        [
            [(tree.after_present if row[p] else tree.after_absent)[q] for q, p in enumerate(tree.parent)]
            for row in words[:3]
        ],
    )


def test_a_chain_is_found_from_its_strongest_link() -> None:
    rng = np.random.default_rng(0)
    words = np.zeros((5000, 4), np.bool_)
    words[:, 2] = rng.random(5000) < 0.5
    for word, source, kept in ((3, 2, 0.95), (1, 2, 0.8), (0, 1, 0.7)):
        words[:, word] = np.where(rng.random(5000) < kept, words[:, source], rng.random(5000) < 0.5)
    tree = learn_tree(counted(words))
    assert edges_of(tree) == {frozenset((2, 3)), frozenset((1, 2)), frozenset((0, 1))}
    assert tree.parent.tolist() in ([1, 2, 2, 2], [1, 2, 3, 3])


def test_words_that_are_never_or_always_there_keep_their_probabilities_inside() -> None:
    words = np.zeros((7, 3), np.bool_)
    words[:, 1] = True
    tree = learn_tree(counted(words))
    assert len(edges_of(tree)) == 2
    for probability in (tree.present, tree.after_present, tree.after_absent):
        assert ((probability >= 0.01 - 1e-12) & (probability <= 0.99 + 1e-12)).all()
    assert tree.present.tolist() == pytest.approx([0.01, 0.99, 0.01])


def test_counting_in_blocks_is_counting_at_once() -> None:
    words = dependent_words(50, 7, 5)
    counts = WordCounts.none(7)
    for start in range(0, 50, 8):
        counts.add(words[start : start + 8])
    whole = counted(words)
    assert counts.frames == 50
    assert (counts.together == whole.together).all()
    assert (counts.together == words.T.astype(int) @ words.astype(int)).all()
