"""Similarity against loops, in blocks as whole, and the best K as a stable sort gives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from everplace.describe.files.descriptors import Descriptors, Metric
from everplace.errors import ConfigError, DescriptorsError
from everplace.match import similarity as module
from everplace.match.similarity import directions, similarity, similarity_blocks, top_k

METRICS: tuple[Metric, ...] = ("cosine", "mean-absolute-difference")

quick = settings(max_examples=30, deadline=None)


def descriptors(values: NDArray[np.floating], metric: Metric = "cosine") -> Descriptors:
    return Descriptors(values.astype(np.float32), tuple(f"frame{i}" for i in range(len(values))), "test", metric)


def random_descriptors(count: int, metric: Metric, seed: int, dimension: int = 5) -> Descriptors:
    return descriptors(np.random.default_rng(seed).standard_normal((count, dimension)), metric)


def slow(query: Descriptors, database: Descriptors) -> NDArray[np.float64]:
    def one(q: NDArray[np.float64], d: NDArray[np.float64]) -> float:
        if query.metric == "mean-absolute-difference":
            return -float(sum(abs(a - b) for a, b in zip(q.tolist(), d.tolist(), strict=True))) / len(q)
        lengths = float(np.sqrt((q * q).sum()) * np.sqrt((d * d).sum()))
        return float(np.dot(q, d)) / lengths if lengths else 0.0

    return np.array([[one(q, d) for d in database.values.astype(np.float64)] for q in query.values.astype(np.float64)])


@quick
@given(
    arrays(np.float32, (3, 4), elements=st.floats(-100, 100, width=32)),
    arrays(np.float32, (5, 4), elements=st.floats(-100, 100, width=32)),
    st.sampled_from(METRICS),
)
def test_similarity_is_that_of_the_formula(
    query: NDArray[np.float32], database: NDArray[np.float32], metric: Metric
) -> None:
    q, d = descriptors(query, metric), descriptors(database, metric)
    S = similarity(q, d)
    assert S.dtype == np.float32
    assert S.shape == (3, 5)
    assert np.allclose(S, slow(q, d), atol=1e-5, rtol=1e-5)


def test_values_done_by_hand() -> None:
    q = np.array([[3.0, 4.0], [0.0, 0.0]])
    d = np.array([[4.0, 3.0], [-3.0, -4.0], [0.0, 0.0]])
    assert similarity(descriptors(q), descriptors(d)) == pytest.approx(np.array([[0.96, -1, 0], [0, 0, 0]]))
    sad: Metric = "mean-absolute-difference"
    assert similarity(descriptors(q, sad), descriptors(d, sad)).tolist() == [[-1, -7, -3.5], [-3.5, -3.5, 0]]


@pytest.mark.parametrize("scale", [1e-44, 1e-30, 1.0, 1e30, 3e38])
def test_cosine_does_not_depend_on_length(scale: float) -> None:
    values = np.array([[1.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    S = similarity(descriptors(values * scale), descriptors(values))
    assert pytest.approx(slow(descriptors(values), descriptors(values)), abs=1e-6) == S


def test_cosine_stays_between_minus_1_and_1() -> None:
    d = random_descriptors(300, "cosine", 0, dimension=7)
    S = similarity(d, d)
    assert S.max() <= 1
    assert S.min() >= -1
    assert np.allclose(np.diag(S), 1)


@pytest.mark.parametrize("metric", METRICS)
def test_blocks_make_up_the_whole(metric: Metric) -> None:
    q, d = random_descriptors(11, metric, 1), random_descriptors(140, metric, 2)
    blocks = list(similarity_blocks(q, d, block=4))
    assert [(rows.start, rows.stop) for rows, _ in blocks] == [(0, 4), (4, 8), (8, 11)]
    assert np.allclose(np.vstack([block for _, block in blocks]), similarity(q, d), atol=1e-6)


def test_an_absolute_difference_does_not_depend_on_what_else_is_compared() -> None:
    metric: Metric = "mean-absolute-difference"
    q, d = random_descriptors(300, metric, 1, dimension=70), random_descriptors(90, metric, 2, dimension=70)
    whole = similarity(q, d)
    for block in (1, 7, 64):
        assert (np.vstack([S for _, S in similarity_blocks(q, d, block=block)]) == whole).all()
    for row, column in ((0, 0), (13, 89), (299, 31)):
        assert similarity(q.take([row]), d.take([column])) == whole[row, column]
    exact = -np.abs(q.values[:, None].astype(np.float64) - d.values[None]).mean(axis=2)
    np.testing.assert_allclose(whole, exact, rtol=1e-6)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("k", [1, 3, 24, 1000])
def test_top_k_is_the_head_of_a_stable_sort(metric: Metric, k: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_BLOCK", 4)
    monkeypatch.setattr(module, "_DATABASE_BLOCK", 6)
    # Few small integers: many exact ties, also across the blocks.
    rng = np.random.default_rng(3)
    q = descriptors(rng.integers(-1, 2, (9, 3)).astype(np.float64), metric)
    d = descriptors(rng.integers(-1, 2, (25, 3)).astype(np.float64), metric)
    S = similarity(q, d)
    order = np.argsort(-S, axis=1, kind="stable")[:, :k]
    indices, scores = top_k(q, d, k)
    assert indices.dtype == np.int64
    assert scores.dtype == np.float32
    assert indices.tolist() == order.tolist()
    assert (scores == np.take_along_axis(S, order, axis=1)).all()


def test_minus_zero_ties_with_zero() -> None:
    sad: Metric = "mean-absolute-difference"
    indices, scores = top_k(descriptors(np.zeros((1, 2)), sad), descriptors(np.zeros((3, 2)), sad), 3)
    assert indices.tolist() == [[0, 1, 2]]
    assert scores.tolist() == [[0, 0, 0]]
    assert not np.signbit(scores).any()


@quick
@given(arrays(np.float32, st.integers(1, 20), elements=st.floats(width=32, allow_nan=False)))
def test_ranking_keys_sort_as_the_scores(scores: NDArray[np.float32]) -> None:
    keys = module._ranking_keys(scores[None], np.arange(len(scores)))[0]
    assert np.argsort(-keys).tolist() == np.argsort(-scores, kind="stable").tolist()
    assert len(set(keys.tolist())) == len(scores)


def test_what_does_not_fit_together_is_refused() -> None:
    d = random_descriptors(2, "cosine", 0)
    for other, message in (
        (replace(d, method="hog"), "the method of the query is test and of the database hog"),
        (random_descriptors(2, "cosine", 0, dimension=6), "dimension of the query is 5 .* 6"),
        (replace(d, metric="mean-absolute-difference"), "metric"),
        (replace(d, settings={"standardise": "full"}), "setting standardise of the query is not set .* full"),
    ):
        for call in (similarity, lambda q, b: top_k(q, b, 1), lambda q, b: list(similarity_blocks(q, b))):
            with pytest.raises(DescriptorsError, match=message):
                call(d, other)
    with pytest.raises(ConfigError, match="best 0 matches"):
        top_k(d, d, 0)


@pytest.mark.parametrize("block", [0, -5])
def test_blocks_of_no_queries_are_refused(block: int) -> None:
    some = random_descriptors(3, "cosine", 0)
    with pytest.raises(ConfigError, match=f"blocks of {block} queries"):
        next(similarity_blocks(some, some, block))


def test_directions_have_length_one_and_nothing_stays_nothing() -> None:
    found = directions(np.array([[3.0, 4.0], [0.0, 0.0], [1e-30, 0.0]], np.float32))
    np.testing.assert_allclose(found, np.array([[0.6, 0.8], [0, 0], [1, 0]], np.float32), rtol=1e-6)
    assert found.dtype == np.float32
