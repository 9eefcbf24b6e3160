"""Thresholds and recalls at wanted precisions, their intervals, and what they are good enough for."""

from __future__ import annotations

import math
import re
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from everplace.errors import DescriptorsError, RouteError
from everplace.scoring.precision_table import PRECISIONS, AtPrecision, good_enough_for, precision_table
from everplace.scoring.scores import evaluate, precision_recall


def drive(
    scores: list[float], right: list[bool], sought: list[bool] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """S and truth of queries whose best match, the first of three frames, has these scores and is right or not."""
    S = np.full((len(scores), 3), -np.inf)
    S[:, 0] = scores
    truth = np.zeros(S.shape, np.bool_)
    truth[:, 0] = right
    truth[:, 2] = ~truth[:, 0] & (np.ones(len(right), np.bool_) if sought is None else np.array(sought))
    return S, truth


def test_a_threshold_is_the_lowest_score_that_keeps_the_precision() -> None:
    # By falling score: 9 right, a wrong one (90 %), 10 right (95 %), 80 right (99 %).
    right = [True] * 9 + [False] + [True] * 10 + [True] * 80
    table = precision_table(*drive([float(score) for score in range(100, 0, -1)], right))
    assert {name: (row.threshold, row.accepted, row.wrong) for name, row in table.items()} == {
        "90": (1.0, 100, 1),
        "95": (1.0, 100, 1),
        "99": (1.0, 100, 1),
        "100": (92.0, 9, 0),
    }
    assert [row.recall for row in table.values()] == [0.99, 0.99, 0.99, 0.09]


def test_equal_scores_are_accepted_at_once() -> None:
    table = precision_table(*drive([3.0, 2.0, 2.0, 1.0], [True, True, False, True]))
    assert (table["100"].threshold, table["100"].accepted, table["100"].recall) == (3.0, 1, 0.25)
    assert table["90"] == table["95"] == table["99"] == table["100"]


def test_what_no_threshold_gives_is_none() -> None:
    table = precision_table(*drive([3.0, 2.0], [False, True]))
    assert table["100"] == AtPrecision(None, 0.0, table["100"].recall_interval, 0, 0)


@given(
    st.lists(st.tuples(st.integers(0, 12), st.booleans(), st.booleans()), min_size=1, max_size=60).filter(
        lambda drawn: any(right or sought for _, right, sought in drawn)
    )
)
@settings(max_examples=60, deadline=None)
def test_the_table_against_the_curve(drawn: list[tuple[int, bool, bool]]) -> None:
    scores, right, sought = zip(*drawn, strict=True)
    S, truth = drive([float(score) for score in scores], list(right), list(sought))
    curve, table = precision_recall(S, truth), precision_table(S, truth)
    assert list(table) == [str(precision) for precision in PRECISIONS]
    for name, row in table.items():
        enough = np.round(curve.precision, 12) >= int(name) / 100
        assert row.recall == pytest.approx(curve.recall[enough].max(initial=0.0))
        low, high = row.recall_interval
        assert 0 <= low <= high <= 1
        if row.threshold is not None:
            accepted = S[:, 0] >= row.threshold
            assert (row.accepted, row.wrong) == (accepted.sum(), (accepted & ~truth[:, 0]).sum())
    assert table["100"].recall == evaluate(S, truth).recall_at_100_precision


@pytest.mark.parametrize("count", [1, 7, 90])
def test_the_interval_is_that_of_a_bootstrap_done_one_draw_at_a_time(count: int) -> None:
    rng = np.random.default_rng(count)
    scores, right = rng.normal(size=count), rng.random(count) < 0.8
    right[0] = True
    S, truth = drive(list(scores + 2 * right), list(right))
    stretch = math.isqrt(count)
    starts = np.random.default_rng(5).integers(0, count, (1000, round(count / stretch)))
    recalls = []
    for row in starts:
        chosen = np.concatenate([np.arange(start, start + stretch) % count for start in row])
        if not truth[chosen].any():
            recalls.append([0.0] * len(PRECISIONS))
            continue
        curve = precision_recall(S[chosen], truth[chosen])
        recalls.append([
            curve.recall[np.round(curve.precision, 12) >= precision / 100].max(initial=0.0) for precision in PRECISIONS
        ])  # fmt: skip
    expected = np.quantile(recalls, (0.025, 0.975), axis=0).T
    table = precision_table(S, truth, seed=5)
    np.testing.assert_allclose([row.recall_interval for row in table.values()], expected, atol=1e-4)
    assert table == precision_table(S, truth, seed=5)


def test_stretches_that_are_right_or_wrong_as_a_whole_make_the_interval_wider() -> None:
    """400 queries tell less when 20 in a row are right or wrong together than when each is so alone."""
    rng = np.random.default_rng(3)
    scores = list(rng.permutation(400).astype(float))

    def width(right: NDArray[np.bool_]) -> float:
        S, truth = drive([score + 400 * one for score, one in zip(scores, right, strict=True)], right.tolist())
        low, high = precision_table(S, truth)["100"].recall_interval
        return high - low

    together = np.repeat(np.arange(20) % 2 == 0, 20)
    assert width(together) > 1.5 * width(rng.permutation(together))


def test_a_long_drive_takes_seconds() -> None:
    rng = np.random.default_rng(0)
    S, truth = drive(list(rng.normal(size=27_000)), list(rng.random(27_000) < 0.9))
    started = time.process_time()
    precision_table(S, truth)
    assert time.process_time() - started < 6.0


def test_what_cannot_be_scored_is_refused() -> None:
    S, truth = drive([1.0, 2.0], [True, True])
    with pytest.raises(RouteError, match="none of the 2 queries has a true match"):
        precision_table(S, np.zeros_like(truth))
    with pytest.raises(DescriptorsError, match="is NaN"):
        precision_table(np.full_like(S, np.nan), truth)


def table_of(**recalls: tuple[float, float, int]) -> dict[str, AtPrecision]:
    """A table of (recall, lower end, accepted) by precision."""
    return {
        str(precision): AtPrecision(0.5, recall, (low, min(1.0, recall + 0.1)), accepted, 0)
        for precision, (recall, low, accepted) in zip(PRECISIONS, recalls.values(), strict=True)
    }


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([(0.9, 0.8, 900), (0.8, 0.7, 800), (0.6, 0.5, 600), (0.1, 0.0, 100)], "for closing loops in a map"),
        # Enough matches, but no recall at 99 %.
        (
            [(0.9, 0.8, 900), (0.8, 0.7, 800), (0.02, 0.0, 20), (0.0, 0.0, 0)],
            "for localising along a drive .* closing loops takes 99 %, at which 2 % of the places are found",
        ),
        # A recall at 99 % that 80 matches cannot tell.
        (
            [(0.9, 0.8, 90), (0.8, 0.7, 80), (0.8, 0.7, 80), (0.8, 0.7, 80)],
            "for localising along a drive .* closing loops takes 99 %, for which 80 accepted matches are too few",
        ),
        ([(0.5, 0.4, 50), (0.03, 0.0, 3), (0.0, 0.0, 0), (0.0, 0.0, 0)], "for proposals of which each is checked"),
        (
            [(0.9, 0.8, 12), (0.9, 0.8, 12), (0.9, 0.8, 12), (0.9, 0.8, 12)],
            "^Nobody can say .* at 90 % precision, 12 accepted matches are too few to tell .30 would",
        ),
        ([(0.04, 0.0, 4), (0.0, 0.0, 0), (0.0, 0.0, 0), (0.0, 0.0, 0)], "^Not good enough to act upon: at 90 % "),
    ],
)
def test_the_sentence_follows_from_the_numbers(rows: list[tuple[float, float, int]], said: str) -> None:
    sentence = good_enough_for(table_of(**{f"at_{index}": row for index, row in enumerate(rows)}))
    assert re.search(said, sentence), sentence
    assert sentence.endswith(".")
    assert sentence.count(". ") == 0
