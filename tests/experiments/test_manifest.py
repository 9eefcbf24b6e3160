"""What manifest.json says: all that decides the numbers, and nothing that changes from run to run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.experiments.comparing import MEASURED, OPTIONS, compare, refused

from everplace.experiments.comparison import COSTS, SCORES
from everplace.experiments.evaluation import evaluate_retrieval
from everplace.experiments.evaluation_report import write_evaluation
from everplace.experiments.manifest import DEFINITIONS, open_study
from everplace.match.matching import Matching
from everplace.route.route import open_route
from everplace.route.selection import Selection, select
from everplace.scoring.retrieval import MatchRule, retrieve


def without_measured(metrics: Any) -> Any:
    """Metrics without the times and memory, which a clock and not the comparison decides."""
    if isinstance(metrics, dict):
        return {name: without_measured(value) for name, value in metrics.items() if name not in MEASURED}
    return [without_measured(one) for one in metrics] if isinstance(metrics, list) else metrics


def manifest_of(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "manifest.json").read_text())
    return found


@pytest.mark.slow
def test_two_runs_have_equal_manifests_and_metrics(finished: Path, tmp_path: Path) -> None:
    metrics = compare(finished / "tiny", tmp_path / "again", *OPTIONS)
    assert without_measured(metrics) == without_measured(json.loads((finished / "c" / "metrics.json").read_text()))
    one, two = (manifest_of(out) for out in (finished / "c", tmp_path / "again"))
    assert one == two
    assert set(one["versions"]) >= {"everplace", "python", "numpy", "opencv", "torch", "pillow"}
    assert one["machine"]["processor"]
    assert [traverse["frames"] for traverse in one["traverses"]] == [10, 10]
    assert one["pairs"] == [
        {"query": "summer", "database": "winter"},
        {"query": "winter", "database": "summer"},
    ]
    assert (one["split"]["frames"], one["truth"]["tolerance"]) == ("2:", 1)
    assert one["fit"] == {}  # the seed is of methods that are fitted
    assert one["methods"]["hog"] == {"method": "hog", "metric": "cosine", "cell": 8, "block": 16, "bins": 9}
    assert set(one["definitions"]) >= {"curve", "auc_pr", "peak MB"}


def test_a_manifest_tells_the_images_of_the_chosen_frames(finished: Path) -> None:
    route = open_route(finished / "tiny")
    same, other = (
        open_study(select(route, Selection(slice(first, None))), MatchRule(), Matching()) for first in (2, 3)
    )
    traverses = manifest_of(finished / "c")["traverses"]
    assert same.document["traverses"] == traverses
    assert [one["sha256"] for one in other.document["traverses"]] != [one["sha256"] for one in traverses]


@pytest.mark.slow
def test_the_protocol_that_chose_the_frames_is_named_in_every_result(tiny_route: Path, tmp_path: Path) -> None:
    (tiny_route / "route.toml").write_text('protocol = "Somewhere, 12 frames, ±1"\ntolerance = 1\n', "utf-8")
    metrics = compare(tiny_route, tmp_path / "c", "--methods", "hog")
    assert metrics["protocol"] == manifest_of(tmp_path / "c")["protocol"] == "Somewhere, 12 frames, ±1"
    head = "tiny (Somewhere, 12 frames, ±1): within ±1 frames, descriptors compared as they are"
    assert (tmp_path / "c" / "table.md").read_text("utf-8").splitlines()[0] == head
    assert "tiny (Somewhere, 12 frames, ±1): 12 places, within ±1 frames" in (tmp_path / "c" / "report.html").read_text(
        "utf-8"
    )
    evaluated = evaluate_retrieval(retrieve(open_route(tiny_route), "winter", "summer", "hog"), "hog")
    assert evaluated.metrics()["protocol"] == "Somewhere, 12 frames, ±1"
    write_evaluation(evaluated, tmp_path / "e", details={})
    assert "tiny (Somewhere, 12 frames, ±1): within ±1 frames, descriptors compared as they are" in (
        tmp_path / "e" / "report.html"
    ).read_text("utf-8")
    (tiny_route / "route.toml").unlink()
    metrics = compare(tiny_route, tmp_path / "none", "--methods", "hog")
    assert metrics["protocol"] is None
    assert (tmp_path / "none" / "table.md").read_text("utf-8").startswith("tiny: within ±1 frames, ")


def test_every_column_is_defined() -> None:
    assert {"recall@N", *(name for name in SCORES if not name.startswith("recall")), *COSTS} < set(DEFINITIONS)


def test_the_costs_stand_in_every_place(finished: Path) -> None:
    out = finished / "c"
    metrics = json.loads((out / "metrics.json").read_text())
    hog = metrics["pairs"][0]["methods"]["hog"]
    assert (hog["dimension"], hog["bytes_per_descriptor"]) == (3780, 15120)
    assert hog["ms_per_image"] > 0
    assert 20 < hog["peak_memory_mb"] < 2000
    table = (out / "table.md").read_text()
    assert f"| 3780 | 15120 | {hog['ms_per_image']:.3f} | {round(hog['peak_memory_mb'])} |" in table
    page = (out / "report.html").read_text()
    assert "<summary>Manifest</summary>" in page
    assert manifest_of(out)["traverses"][0]["sha256"] in page


def test_another_study_in_the_same_directory_is_refused(finished_copy: Path) -> None:
    before = (finished_copy / "c" / "manifest.json").read_bytes()
    for options, names in (
        (["--tolerance", "3"], "truth.tolerance was 1 and is now 3"),
        (["--frames", "3:"], 'split.frames was "2:" and is now "3:"'),
        (["--conditions", "winter,summer"], 'split.conditions was [] and is now ["winter", "summer"]'),
        (["--standardise", "centre"], 'match.standardise was null and is now "centre"'),
    ):
        said = refused(finished_copy / "tiny", finished_copy / "c", *OPTIONS, *options)
        assert "holds a comparison with other settings" in said
        assert names in said
    assert (finished_copy / "c" / "manifest.json").read_bytes() == before


def test_other_images_or_a_foreign_manifest_are_refused(finished_copy: Path) -> None:
    route, out = finished_copy / "tiny", finished_copy / "c"
    Image.new("RGB", (64, 32), (9, 9, 9)).save(route / "winter" / "5.png")
    assert "traverses.1.sha256" in refused(route, out, *OPTIONS)
    (out / "manifest.json").write_text("[1]")
    assert "manifest.json was not written by" in refused(route, out, *OPTIONS)


def test_the_key_depends_on_study_and_settings_alone(tiny_route: Path) -> None:
    route = open_route(tiny_route)
    study = open_study(route, MatchRule(), Matching())
    assert study.key({"a": 1, "b": 2}) == open_study(route, MatchRule(1), Matching()).key({"b": 2, "a": 1})
    others = [
        study.key({"a": 1, "b": 3}),
        open_study(route, MatchRule(2), Matching()).key({"a": 1, "b": 2}),
        open_study(route, MatchRule(), Matching(sequence=2)).key({"a": 1, "b": 2}),
        open_study(select(route, Selection(slice(1, None))), MatchRule(), Matching()).key({"a": 1, "b": 2}),
    ]
    assert len({study.key({"a": 1, "b": 2}), *others}) == 5
