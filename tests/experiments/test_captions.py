"""The words of reports and pictures."""

from __future__ import annotations

import pytest

from everplace.experiments.captions import (
    match_caption,
    match_note,
    matching_words,
    matrix_caption,
    pair_words,
    right_words,
    score_words,
)
from everplace.match.matching import Matching
from everplace.scoring.retrieval import MatchRule


def test_query_and_database_are_told_apart() -> None:
    assert pair_words("summer", "winter") == "query summer, database winter"
    caption = matrix_caption("summer", "winter", MatchRule(tolerance=3), "cosine similarity")
    assert "row is a frame of the query summer, each column one of the database winter" in caption
    assert "within ±3 frames" in caption


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (MatchRule(tolerance=3), "within ±3 frames"),
        (MatchRule(radius=25.0), "within 25 m"),
        (MatchRule(pairs="pairs.csv"), "among the pairs of pairs.csv"),
    ],
)
def test_what_counts_as_right_is_said_with_its_number(truth: MatchRule, said: str) -> None:
    assert right_words(truth) == said
    assert match_note(truth, "cosine similarity") == f"right: {said}; number: cosine similarity"
    assert f"counts as right {said}, so it need not be the very frame" in match_caption(truth, "cosine similarity")


@pytest.mark.parametrize(
    ("matching", "said", "score"),
    [
        (Matching(), "descriptors compared as they are", "cosine similarity"),
        (Matching("centre"), "standardised (centre)", "cosine similarity"),
        (Matching(sequence=5), "sequences of 5 (filter, stops not counted)", "log-odds over sequences of 5"),
        (
            Matching(sequence=5, sequence_method="mean"),
            "sequences of 5 (mean)",
            "mean cosine similarity over sequences of 5",
        ),
    ],
)
def test_how_descriptors_were_compared_and_what_the_number_is(matching: Matching, said: str, score: str) -> None:
    assert matching_words(matching) == said
    assert score_words("cosine", matching) == score


def test_the_score_of_each_metric_is_named() -> None:
    assert score_words("mean-absolute-difference", Matching()) == "negative mean absolute difference"
    assert score_words("place-posterior", Matching()) == "log probability of the place"
