"""The sentences that reports begin with."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.experiments.comparing import compare

from everplace.experiments.evaluation import evaluate_retrieval
from everplace.experiments.evaluation_report import write_evaluation
from everplace.experiments.lead import comparison_lead, evaluation_lead, sequence_sentence
from everplace.match.matching import Matching
from everplace.route.route import open_route
from everplace.scoring.retrieval import retrieve
from everplace.scoring.scores import evaluate


def test_an_evaluation_says_how_many_places_were_found(tiny_route: Path) -> None:
    result = retrieve(open_route(tiny_route), "winter", "summer", "hog")
    assert evaluation_lead(result, "hog (mine)") == (
        "hog (mine) finds 12 of 12 places of winter in summer at its first guess (100 %), and 12 among its first five."
    )


def test_drives_that_are_not_aligned_are_said_to_be(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    lead = evaluation_lead(retrieve(open_route(tiny_route), "winter", "summer", "sad"), "sad")
    assert lead.startswith("sad proposes a frame of summer for each of the 12 frames of winter; which")


@pytest.mark.parametrize(
    ("found", "pairs", "said"),
    [
        ({"sad": 0.1, "hog": 0.75, "vae": 0.5}, 2, "hog finds most: 75 % {} both directions; then vae 50 %, sad 10 %."),
        ({"sad": 0.5}, 12, "sad finds most: 50 % {} 12 pairs of conditions."),
        ({"b": 0.5, "a": 0.5}, 2, "b finds most: 50 % {} both directions; then a 50 %."),
    ],
)
def test_a_comparison_names_the_best_method(found: dict[str, float], pairs: int, said: str) -> None:
    assert comparison_lead(found, pairs) == said.format("of the places at its first guess, in the mean over")


@pytest.mark.parametrize(
    "matching", [Matching(sequence=3), Matching("centre", 4, "seqslam"), Matching(sequence=5, sequence_method="mean")]
)
def test_the_effect_of_sequences_is_shown(tiny_route: Path, tmp_path: Path, matching: Matching) -> None:
    route = open_route(tiny_route)
    result = retrieve(route, "winter", "summer", "sad", matching=matching)
    alone = retrieve(route, "winter", "summer", "sad", matching=Matching(matching.standardise)).scores
    assert result.frame_by_frame == alone
    assert alone is not None
    assert result.scores is not None
    write_evaluation(evaluate_retrieval(result, "sad"), tmp_path, details={})
    said = sequence_sentence(matching, {"sad": alone}, {"sad": result.scores})
    assert f"sequences of {matching.sequence}" in said
    assert f"recall@1 {alone.recall_at[1]:.3f} without and {result.scores.recall_at[1]:.3f} with them" in said
    page = (tmp_path / "report.html").read_text("utf-8")
    assert f"<p>{said}</p>" in page
    assert page.index('<p class="lead">') < page.index("<dl")
    assert json.loads((tmp_path / "metrics.json").read_text())["frame_by_frame"] == alone.to_dict()


def test_without_sequences_nothing_is_said_of_them(tiny_route: Path) -> None:
    result = retrieve(open_route(tiny_route), "winter", "summer", "sad")
    assert result.frame_by_frame is None
    some = evaluate(np.eye(3), np.eye(3, dtype=bool))
    assert sequence_sentence(Matching(), {"a": some}, {"a": some}) == ""


def test_a_comparison_shows_the_sequences_of_every_pair(tiny_route: Path, tmp_path: Path) -> None:
    metrics = compare(tiny_route, tmp_path / "c", "--methods", "sad,hog", "--sequence", "3")
    assert all("frame_by_frame" in one for pair in metrics["pairs"] for one in pair["methods"].values())
    page = (tmp_path / "c" / "report.html").read_text("utf-8")
    assert page.count("Places are scored over sequences of 3 (filter, stops not counted); sad: recall@1 ") == 2
    assert page.count('<p class="lead">') == 1
