"""The demo, smaller: the same way from nothing to a report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from everplace.experiments.rendered_demo import DemoSettings, run_demo

SMALL = replace(DemoSettings(), places=70, trained="0:45", tested="50:", epochs=1, rendered=(32, 64), seen=(32, 32))


@pytest.mark.slow
def test_the_demo_goes_from_nothing_to_a_report(tmp_path: Path) -> None:
    metrics = run_demo(tmp_path / "demo", SMALL, details={"command": "everplace demo"})
    assert json.loads((tmp_path / "demo" / "metrics.json").read_text()) == json.loads(json.dumps(metrics))
    assert set(metrics["mean_auc_pr"]) == {"c-vae", "cp-vae", "cp-vae-best", "sad", "hog"}
    assert {(pair["query"], pair["database"]) for pair in metrics["pairs"]} == {
        ("summer", "winter"),
        ("winter", "summer"),
    }
    page = (tmp_path / "demo" / "report.html").read_text()
    assert "Training of cp-vae" in page
    weights = (tmp_path / "demo" / "runs" / "cp-vae" / "checkpoint.json").read_bytes()

    # A second call finds the route and the runs, and only compares anew.
    run_demo(tmp_path / "demo", SMALL, details={"command": "everplace demo"})
    assert (tmp_path / "demo" / "runs" / "cp-vae" / "checkpoint.json").read_bytes() == weights
