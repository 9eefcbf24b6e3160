"""The demo, smaller: the same way from nothing to a report."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import pytest

from everplace.experiments.rendered_demo import MAP, DemoSettings, run_demo
from everplace.mapping.route_map import Map

T = TypeVar("T")
SMALL = replace(DemoSettings(), places=70, trained="0:45", tested="50:", epochs=1, rendered=(32, 64), seen=(32, 32))


@pytest.mark.slow
def test_the_demo_goes_from_nothing_to_a_report(tmp_path: Path) -> None:
    steps: list[str] = []

    def note(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
        steps.append(what)
        yield from items

    metrics = run_demo(tmp_path / "demo", SMALL, details={"command": "everplace demo"}, progress=note)
    # What takes more than two seconds after the training shows itself.
    assert {"timing hog", "memory of hog", "scoring hog", "auditing cp-vae", "the report"} <= set(steps)
    assert json.loads((tmp_path / "demo" / "metrics.json").read_text()) == json.loads(json.dumps(metrics))
    assert set(metrics["mean_auc_pr"]) == {"c-vae", "cp-vae", "cp-vae-best", "sad", "hog"}
    assert {(pair["query"], pair["database"]) for pair in metrics["pairs"]} == {
        ("summer", "winter"),
        ("winter", "summer"),
    }
    page = (tmp_path / "demo" / "report.html").read_text()
    assert "Training of cp-vae" in page
    shown = Map.open(tmp_path / "demo" / MAP)
    assert (shown.drives, shown.version, len(shown.thumbnails())) == (("summer",), 1, 70)
    weights = (tmp_path / "demo" / "runs" / "cp-vae" / "checkpoint.json").read_bytes()

    # A second call finds the route, the runs and the map, and only compares anew.
    run_demo(tmp_path / "demo", SMALL, details={"command": "everplace demo"})
    assert (tmp_path / "demo" / "runs" / "cp-vae" / "checkpoint.json").read_bytes() == weights
    assert Map.open(tmp_path / "demo" / MAP).version == 1
