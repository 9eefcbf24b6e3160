"""The study of sequence searches, whole, on a small route."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.mark.slow
def test_every_search_is_measured_on_every_drive(
    unchanged_tiny_route: Path, run_study: Callable[..., None], tmp_path: Path
) -> None:
    (tmp_path / "nordland64").symlink_to(unchanged_tiny_route)
    options = ["--methods", "hog", "--frames", ":", "--lengths", "3", "--seeds", "2"]
    run_study("sequences", tmp_path, tmp_path / "out", *options)
    plain, centred = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert [plain["standardise"], centred["standardise"]] == [None, "centre"]
    assert [row["drive"] for row in plain["drives"]][:2] == ["as recorded", "as recorded, standing too"]
    searches = ["mean, 3 frames", "seqslam, 3 frames", "filter, 3 frames", "motion known, 3 frames"]
    assert set(searches) < set(plain["drives"][0]["scores"])
    assert plain["drives"][0]["scores"]["one frame"] == [1.0, 1.0]
    against = {row["drive"]: row.get("against recorded") for row in plain["drives"]}
    assert against["as recorded"] is against["and a fifth off the map"] is None
    assert set(against["speeds 0.7 to 1.4, stops"]) == {"filter, 3 frames"}
    table = (tmp_path / "out" / "table.md").read_text()
    assert "**hog, plain**: recall@1 / auc_pr" in table
    assert "filter, 3 frames" in table
