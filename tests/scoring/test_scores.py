"""Scores against slow computations written from the definitions, scikit-learn, and cases done by hand."""

from __future__ import annotations

import itertools
import json
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from sklearn.metrics import average_precision_score

from everplace.errors import DescriptorsError, RouteError
from everplace.scoring import scores
from everplace.scoring.scores import evaluate, precision_recall

Matrix = NDArray[np.float64]
Truth = NDArray[np.bool_]

quick = settings(max_examples=40, deadline=None)


@st.composite
def matrices(draw: st.DrawFn) -> tuple[Matrix, Truth]:
    """Small matrices with many ties, and a truth with one true pair at least."""
    shape = draw(st.tuples(st.integers(1, 7), st.integers(1, 7)))
    S = draw(arrays(np.float64, shape, elements=st.integers(-3, 3).map(float)))
    truth = draw(arrays(np.bool_, shape).filter(lambda truth: bool(truth.any())))
    return S, truth


@st.composite
def matrices_without_ties(draw: st.DrawFn) -> tuple[Matrix, Truth]:
    rows, columns = draw(st.tuples(st.integers(1, 6), st.integers(1, 6)))
    order = draw(st.permutations(range(rows * columns)))
    truth = draw(arrays(np.bool_, (rows, columns)).filter(lambda truth: bool(truth.any())))
    return np.array(order, np.float64).reshape(rows, columns), truth


def slow_curve(S: Matrix, truth: Truth) -> list[tuple[float, float]]:
    """(recall, precision) for every distinct best score, falling, in plain Python."""
    proposals = []
    for row, same in zip(S.tolist(), truth.tolist(), strict=True):
        best = row.index(max(row))
        proposals.append((row[best], same[best]))
    sought = sum(any(same) for same in truth.tolist())
    points = []
    for threshold in sorted({score for score, _ in proposals}, reverse=True):
        accepted = [right for score, right in proposals if score >= threshold]
        points.append((sum(accepted) / sought, sum(accepted) / len(accepted)))
    return points


def slow_area(points: list[tuple[float, float]]) -> float:
    area = points[0][0] * points[0][1]
    for (recall0, precision0), (recall1, precision1) in itertools.pairwise(points):
        area += (recall1 - recall0) * (precision0 + precision1) / 2
    return area


def slow_recall_at(S: Matrix, truth: Truth, count: int) -> float:
    found = []
    for row, same in zip(S.tolist(), truth.tolist(), strict=True):
        if any(same):
            ranked = sorted(range(len(row)), key=lambda j: (-row[j], j))
            found.append(any(same[j] for j in ranked[:count]))
    return sum(found) / len(found)


def diagonal(size: int) -> Truth:
    return np.eye(size, dtype=np.bool_)


# ---- against independent computations


@quick
@given(matrices())
def test_the_curve_is_the_one_of_the_definition(case: tuple[Matrix, Truth]) -> None:
    S, truth = case
    curve = precision_recall(S, truth)
    points = slow_curve(S, truth)
    assert np.allclose(np.column_stack([curve.recall, curve.precision]), points)
    assert curve.area == pytest.approx(slow_area(points))
    assert curve.recall_at_100_precision == max((r for r, p in points if p == 1), default=0)
    assert curve.extended_precision == pytest.approx((points[0][1] + curve.recall_at_100_precision) / 2)
    assert sorted(curve.threshold.tolist(), reverse=True) == curve.threshold.tolist()


@quick
@given(matrices())
def test_recall_at_n_counts_as_a_stable_sort_would(case: tuple[Matrix, Truth]) -> None:
    S, truth = case
    assert evaluate(S, truth).recall_at == {str(n): slow_recall_at(S, truth, n) for n in (1, 5, 10)}


@quick
@given(matrices())
def test_average_precision_is_that_of_scikit_learn(case: tuple[Matrix, Truth]) -> None:
    S, truth = case
    assert evaluate(S, truth).average_precision == pytest.approx(average_precision_score(truth.ravel(), S.ravel()))


def test_blocks_of_rows_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    S = rng.integers(0, 40, (53, 31)).astype(np.float32)
    truth = rng.random((53, 31)) < 0.05
    whole = evaluate(S, truth)
    monkeypatch.setattr(scores, "_BLOCK", 100)
    assert evaluate(S, truth) == whole
    assert whole.average_precision == pytest.approx(average_precision_score(truth.ravel(), S.ravel()))


# ---- by hand


def test_a_curve_done_by_hand() -> None:
    # Best scores .9 right, .8 wrong, .7 right, and .6 of a query without a true match: 3 queries are sought.
    S = np.array([[0.9, 0.1, 0, 0], [0.8, 0.2, 0, 0], [0, 0, 0.7, 0], [0, 0, 0, 0.6]])
    truth = diagonal(4)
    truth[3, 3] = False
    curve = precision_recall(S, truth)
    assert curve.recall.tolist() == pytest.approx([1 / 3, 1 / 3, 2 / 3, 2 / 3])
    assert curve.precision.tolist() == pytest.approx([1, 1 / 2, 2 / 3, 1 / 2])
    assert curve.threshold.tolist() == [0.9, 0.8, 0.7, 0.6]
    result = evaluate(S, truth)
    assert result.auc_pr == pytest.approx(1 / 3 + 1 / 3 * (1 / 2 + 2 / 3) / 2)
    assert result.recall_at_100_precision == pytest.approx(1 / 3)
    assert result.extended_precision == pytest.approx((1 + 1 / 3) / 2)
    assert result.recall_at == pytest.approx({"1": 2 / 3, "5": 1, "10": 1})
    assert (result.queries, result.queries_with_match, result.database) == (4, 3, 4)


def test_equal_scores_of_two_queries_enter_the_curve_at_once() -> None:
    S = np.array([[0.9, 0.0], [0.9, 0.0]])  # the first is right, the second wrong
    curve = precision_recall(S, diagonal(2))
    assert (curve.recall.tolist(), curve.precision.tolist()) == ([0.5], [0.5])
    assert curve.area == 0.25  # the rectangle alone
    assert curve.recall_at_100_precision == 0
    assert curve.extended_precision == 0.25


def test_of_equal_database_frames_the_first_is_proposed() -> None:
    S = np.array([[1.0, 1.0, 0.0]])
    assert evaluate(S, np.array([[True, False, False]])).recall_at == {"1": 1, "5": 1, "10": 1}
    assert evaluate(S, np.array([[False, True, False]])).recall_at == {"1": 0, "5": 1, "10": 1}


def test_any_of_several_true_matches_is_right() -> None:
    S = np.array([[0.1, 0.5, 0.9, 0.2]])
    truth = np.array([[True, False, True, False]])
    assert evaluate(S, truth).recall_at["1"] == 1
    assert evaluate(S, truth).average_precision == pytest.approx((1 + 2 / 4) / 2)  # ranks 1 and 4


def test_a_query_without_true_match_costs_precision_but_is_not_sought() -> None:
    S = np.array([[0.5, 0.0], [0.9, 0.0]])
    truth = np.array([[True, False], [False, False]])
    result = evaluate(S, truth)
    assert result.recall_at["1"] == 1
    curve = precision_recall(S, truth)
    assert (curve.recall.tolist(), curve.precision.tolist()) == ([0, 1], [0, 0.5])
    assert result.extended_precision == 0
    assert result.auc_pr == 0.25


def test_the_curve_of_wrong_best_matches_does_not_reach_recall_1() -> None:
    S = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]])
    truth = np.array([[False, True], [False, True], [True, False]])
    assert precision_recall(S, truth).recall[-1] == pytest.approx(1 / 3)


@pytest.mark.parametrize("right", [True, False])
def test_one_frame(right: bool) -> None:
    S = np.array([[0.3, 0.1]])
    result = evaluate(S, np.array([[right, not right]]))
    assert result.auc_pr == result.extended_precision == result.recall_at_100_precision == float(right)
    assert result.recall_at == {"1": float(right), "5": 1, "10": 1}
    assert result.average_precision == (1 if right else 0.5)


def test_infinite_scores_are_scores() -> None:
    S = np.array([[-np.inf, np.inf], [-np.inf, -np.inf]])
    truth = np.array([[False, True], [True, False]])
    assert evaluate(S, truth).recall_at["1"] == 1


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int64, np.float16, np.float32])
def test_scores_of_any_number_type(dtype: type[Any]) -> None:
    S = np.array([[3, 1, 2], [1, 2, 3]])
    truth = np.array([[True, False, False], [False, True, False]])
    assert evaluate(S.astype(dtype), truth) == evaluate(S.astype(np.float64), truth)


# ---- properties


@quick
@given(matrices())
def test_scores_stay_in_their_bounds(case: tuple[Matrix, Truth]) -> None:
    result = evaluate(*case)
    for value in (result.auc_pr, result.average_precision, result.extended_precision):
        assert 0 <= value <= 1 + 1e-12
    assert 0 <= result.recall_at_100_precision <= result.recall_at["1"]
    assert result.recall_at["1"] <= result.recall_at["5"] <= result.recall_at["10"] <= 1
    curve = precision_recall(*case)
    assert (np.diff(curve.recall) >= 0).all()
    assert curve.recall[-1] == pytest.approx(result.recall_at["1"])


@quick
@given(matrices())
def test_only_the_order_of_scores_counts(case: tuple[Matrix, Truth]) -> None:
    S, truth = case
    assert evaluate(S**3 + 2 * S + 5, truth) == evaluate(S, truth)


@quick
@given(matrices_without_ties(), st.randoms(use_true_random=False))
def test_the_order_of_frames_does_not_count(case: tuple[Matrix, Truth], random: Any) -> None:
    S, truth = case
    rows, columns = (random.sample(range(size), size) for size in S.shape)
    assert evaluate(S[rows][:, columns], truth[rows][:, columns]) == evaluate(S, truth)


@quick
@given(arrays(np.bool_, (4, 5)).filter(lambda truth: bool(truth.any(axis=1).all())))
def test_perfect_scores_give_1(truth: Truth) -> None:
    result = evaluate(truth.astype(np.float32), truth)
    assert result.recall_at == {"1": 1, "5": 1, "10": 1}
    assert result.auc_pr == result.average_precision == 1
    assert result.recall_at_100_precision == result.extended_precision == 1


# ---- misuse


@pytest.mark.parametrize("call", [evaluate, precision_recall])
def test_every_function_names_what_is_wrong(call: Any) -> None:
    S = np.zeros((3, 4))
    truth = np.zeros((3, 4), np.bool_)
    truth[1, 2] = True
    with pytest.raises(DescriptorsError, match=r"\(3, 4\).*\(4, 3\)"):
        call(S, truth.T)
    with pytest.raises(DescriptorsError, match="int64"):
        call(S, truth.astype(np.int64))
    with pytest.raises(DescriptorsError, match=r"\(3,\)"):
        call(S[:, 0], truth[:, 0])
    with pytest.raises(DescriptorsError, match="object"):
        call(S.astype(object), truth)
    with pytest.raises(DescriptorsError, match="empty"):
        call(S[:0], truth[:0])
    with pytest.raises(DescriptorsError, match="empty"):
        call(S[:, :0], truth[:, :0])
    with pytest.raises(RouteError, match="none of the 3 queries has a true match"):
        call(S, np.zeros_like(truth))
    S[2, 1] = np.nan
    with pytest.raises(DescriptorsError, match="query 2 and database frame 1 is NaN"):
        call(S, truth)


def test_arguments_are_left_alone() -> None:
    rng = np.random.default_rng(1)
    S, truth = rng.random((20, 20)), rng.random((20, 20)) < 0.1
    kept = S.copy(), truth.copy()
    evaluate(S, truth)
    assert (kept[0] == S).all()
    assert (truth == kept[1]).all()


def test_scores_are_json() -> None:
    result = evaluate(np.eye(3, dtype=np.float32), diagonal(3))
    assert json.loads(json.dumps(result.to_dict())) == result.to_dict()
    assert set(result.to_dict()["recall_at"]) == {"1", "5", "10"}


def test_memory_stays_below_a_copy_of_the_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scores, "_BLOCK", 1 << 16)
    S = np.random.default_rng(0).random((1500, 1500), dtype=np.float32)
    truth = np.eye(1500, dtype=np.bool_)
    evaluate(S, truth)  # what is loaded on first use is not the question
    tracemalloc.start()
    evaluate(S, truth)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < S.nbytes / 4


def test_recall_is_found_by_number_and_by_text_and_stays_text_in_json() -> None:
    scores = evaluate(np.eye(3), np.eye(3, dtype=bool))
    assert scores.recall_at[1] == scores.recall_at["1"] == 1.0
    assert json.loads(json.dumps(scores.to_dict()))["recall_at"] == {"1": 1.0, "5": 1.0, "10": 1.0}
    assert repr(scores).startswith("Scores(recall@1 1.000, ")
    assert len(repr(scores)) < 160
