"""The baselines reach, on real data, the values that were measured for them independently.

`nordland64`, tunnels and stops removed, places 1,620 to 2,001, winter against summer, ±1 place.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

import pytest

from everplace.choices import Standardisation
from everplace.describe.registry import open_describer
from everplace.match.similarity import similarity
from everplace.match.standardise import standardise
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, parse_frames, select
from everplace.route.truth import truth_by_position
from everplace.scoring.scores import Scores, evaluate


@pytest.fixture(scope="module")
def route(shared_data: Path) -> Route:
    selection = Selection(frames=parse_frames("1620:"), drop_dark=True, drop_stationary=True)
    return select(open_route(shared_data / "nordland64"), selection)


def score(route: Route, method: str, how: str | None) -> Scores:
    describer = open_describer(method)
    query, database = (describer.describe(route[condition]) for condition in ("winter", "summer"))
    if how is not None:
        query, database = (standardise(side, cast("Standardisation", how)) for side in (query, database))
    return evaluate(similarity(query, database), truth_by_position(route["winter"], route["summer"], 1))


@pytest.mark.parametrize(
    ("method", "how", "recall_at_1", "auc_pr"),
    [
        ("sad", None, 0.280, 0.171),
        ("hog", None, 0.589, 0.402),
        ("hog", "full", 0.662, 0.556),
        ("hog", "centre", 0.707, 0.614),
    ],
)
def test_baselines_reach_the_reference_values(
    route: Route, method: str, how: str | None, recall_at_1: float, auc_pr: float
) -> None:
    scores = score(route, method, how)
    assert (scores.queries, scores.queries_with_match, scores.database) == (382, 382, 382)
    assert scores.recall_at["1"] == pytest.approx(recall_at_1, abs=0.02)
    assert scores.auc_pr == pytest.approx(auc_pr, abs=0.02)
