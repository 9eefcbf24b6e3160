"""Where a truth comes from, when it is circular, and which tested places a run has seen."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from tests.experiments.comparing import untrained_run

from everplace.cli import main
from everplace.describe.registry import open_describer
from everplace.experiments.trust import circular_sentence, seen_places, seen_sentence, truth_source
from everplace.route.route import Route, open_route
from everplace.scoring.retrieval import MatchRule
from everplace.training.seen_images import seen_images

GRADIENTS = "z_p from oriented gradients (ridge 1, stretches 2, light 3, rate 4)"


def aligned(route: Path, by: str = "hog") -> Route:
    (route / "route.toml").write_text(f'truth_from = "an alignment by the images"\naligned_by = "{by}"\n')
    return open_route(route)


def test_the_source_of_the_truth_is_that_of_the_rule(tiny_route: Path) -> None:
    route = aligned(tiny_route)
    assert truth_source(route, MatchRule(tolerance=1)) == "an alignment by the images"
    assert truth_source(route, MatchRule(radius=5.0)) == "the poses of the drives"
    assert truth_source(route, None) is None
    posed = replace(route, radius=5.0, truth_origin="positions by GPS")
    assert truth_source(posed, MatchRule(radius=5.0)) == "positions by GPS"
    assert truth_source(posed, MatchRule(tolerance=1)) == "equal names of frames"
    bare = replace(route, truth_origin=None)
    assert truth_source(bare, MatchRule(tolerance=1)) == "equal names of frames"
    assert truth_source(bare, MatchRule(pairs="truth.csv")) == "the pairs of truth.csv"


@pytest.mark.parametrize(
    ("by", "method", "rule", "circular"),
    [
        ("hog", "hog", MatchRule(tolerance=1), True),
        ("hog16", "hog", MatchRule(tolerance=0), True),
        ("hog16+efficientnet", "hog", MatchRule(tolerance=1), True),
        ("hog", "best", MatchRule(tolerance=1), True),
        ("cae", "best", MatchRule(tolerance=1), True),
        ("hog", "sad", MatchRule(tolerance=1), False),
        ("hog", "hog", MatchRule(radius=5.0), False),
        ("hog", "hog", MatchRule(pairs="truth.csv"), False),
        ("hog", "hog", None, False),
        ("hub:someone/hog:x", "hog", MatchRule(tolerance=1), False),
    ],
)
def test_a_method_that_made_the_truth_is_told(
    tiny_route: Path, tmp_path: Path, by: str, method: str, rule: MatchRule | None, circular: bool
) -> None:
    if method == "best":
        method = str(untrained_run(tmp_path / "run", recipe="best", remedies=GRADIENTS))
    said = circular_sentence("mine", open_describer(method), aligned(tiny_route, by), rule)
    assert bool(said) is circular
    assert not said or said.startswith(f"The drives were aligned by {by}, and mine looks at images as that did")


@pytest.mark.parametrize("command", ["evaluate", "compare"])
def test_metrics_reports_and_tables_tell_the_truth_and_warn(
    tiny_route: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    aligned(tiny_route)
    out = tmp_path / "out"
    asked = ["--method", "hog", "--query", "winter", "--database", "summer"]
    asked = ["--methods", "hog,sad"] if command == "compare" else asked
    assert main.run([command, str(tiny_route), *asked, "--out", str(out)]) == 0
    assert capsys.readouterr().err.count("The drives were aligned by hog, and hog looks at images as that did") == 1
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["truth_from"], metrics["aligned_by"]) == ("an alignment by the images", "hog")
    page = (out / "report.html").read_text("utf-8")
    assert "What is right is known from an alignment by the images." in page
    assert "its scores say how well it agrees with the alignment" in page
    if command == "compare":
        table = (out / "table.md").read_text("utf-8")
        assert "\nTruth: an alignment by the images\n" in table
        assert table.count("its scores say how well it agrees with the alignment") == 1


def run_that_saw(route: Path, run: Path, stems: list[str]) -> Path:
    """A run whose checkpoint says that it was trained on these places of a route's summer."""
    opened = open_route(route)
    return untrained_run(run, trained_stems=stems, seen_images=seen_images(opened, opened.only(["summer"]), stems))


def test_places_are_known_by_their_images_under_any_name(tiny_route: Path, tmp_path: Path) -> None:
    describer = open_describer(str(run_that_saw(tiny_route, tmp_path / "run", ["3", "4"])))
    assert seen_places(describer, open_route(tiny_route)) == 2
    renamed = Path(shutil.copytree(tiny_route, tmp_path / "renamed"))
    for path in list(renamed.rglob("*.png")):
        path.rename(path.with_name(f"frame{path.name}"))
    assert seen_places(describer, open_route(renamed)) == 2
    assert "2 of the tested places were among those that mine was trained on" in seen_sentence("mine", describer, 2)


def test_a_place_is_seen_in_conditions_that_were_not_trained_on(tiny_route: Path, tmp_path: Path) -> None:
    describer = open_describer(str(run_that_saw(tiny_route, tmp_path / "run", ["3", "4", "5"])))
    assert seen_places(describer, open_route(tiny_route).only(["winter"])) == 3


def test_equal_names_on_another_route_are_no_seen_places(tiny_route: Path, tmp_path: Path) -> None:
    describer = open_describer(str(run_that_saw(tiny_route, tmp_path / "run", ["3", "4"])))
    other = Path(shutil.copytree(tiny_route, tmp_path / "other"))
    for path in (*other.glob("*/3.png"), *other.glob("*/4.png")):
        shutil.copy(other / path.parent.name / "7.png", path)
    assert seen_places(describer, open_route(other)) == 0


def test_an_old_run_is_judged_by_names(tiny_route: Path, tmp_path: Path) -> None:
    describer = open_describer(str(untrained_run(tmp_path / "run", trained_stems=["3", "99"])))
    assert seen_places(describer, open_route(tiny_route)) == 1
    assert "carry the names of places" in seen_sentence("mine", describer, 1)


def test_a_drive_that_cannot_be_read_is_no_hindrance_unless_it_is_trained_on(tiny_route: Path) -> None:
    (tiny_route / "winter" / "3.png").unlink()
    (tiny_route / "winter" / "3.png").symlink_to(tiny_route / "nowhere.png")
    route = open_route(tiny_route)
    assert len(seen_images(route, route.only(["summer"]), ["2", "4"])) == 4
    assert len(seen_images(route, route.only(["summer"]), ["2", "3"])) == 2
