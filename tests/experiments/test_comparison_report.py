"""What a comparison writes beside its numbers."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from tests.experiments.comparing import untrained_run

from everplace import locking
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError
from everplace.experiments.comparison import Comparison, compare_methods
from everplace.experiments.comparison_methods import Methods
from everplace.experiments.comparison_report import write_comparison
from everplace.experiments.manifest import open_study
from everplace.locking import locked
from everplace.match.matching import Matching
from everplace.route.route import open_route
from everplace.scoring.retrieval import MatchRule


def written(route: Path, out: Path, **methods: str | Path) -> Comparison:
    """The comparison of methods by label, written to a directory; no peak memory is measured."""
    describers = {label: open_describer(str(method)) for label, method in methods.items()}
    comparison = compare_methods(open_study(open_route(route), MatchRule(), Matching()), Methods(describers), out)
    write_comparison(comparison, out, title="c", details={})
    return comparison


def visible(out: Path) -> str:
    """The text of the report that shows without opening anything."""
    return re.sub(r"<details.*?</details>", "", (out / "report.html").read_text("utf-8"), flags=re.DOTALL)


@pytest.mark.slow
def test_recipe_and_remedies_are_named_at_every_table(tiny_route: Path, tmp_path: Path) -> None:
    remedies = "no fully connected chain, free bits (2 nats a dimension)"
    mine = untrained_run(tmp_path / "mine", "vae", recipe="best", remedies=remedies, seed=1)
    plain = untrained_run(tmp_path / "plain", recipe="faithful", remedies="", seed=1)
    out = tmp_path / "out"
    written(tiny_route, out, mine=mine, plain=plain, hog="hog")
    said = f"mine: recipe best; remedies: {remedies}"
    assert said in (out / "table.md").read_text("utf-8").replace("  \n", "\n").splitlines()
    # Of the summary, of each of the two pairs and of the audit.
    assert visible(out).count(f"<p>{said}</p>") == 4
    page = visible(out)
    pictures = re.findall(r'alt="([^"]*)"', page)
    assert any(alt.startswith("Similarity matrix of") for alt in pictures)
    for named in ("mine (recipe best, free bits)",):
        assert f'"name":"{named}' in page
        assert f"{named}: whether the latent is alive" in page
    assert "plain (" not in page
    assert "plain: " not in (out / "table.md").read_text("utf-8") + visible(out)
    assert json.loads((out / "metrics.json").read_text())["methods"] == {
        "mine": {"recipe": "best", "remedies": remedies, "trained_places_tested": 0},
        "plain": {"recipe": "faithful", "remedies": "", "trained_places_tested": 0},
        "hog": {"trained_places_tested": 0},
    }


@pytest.mark.slow
def test_testing_on_trained_places_is_recorded(tiny_route: Path, tmp_path: Path) -> None:
    seen = untrained_run(tmp_path / "seen", trained_stems=["3", "4", "99"], held_out_stems=["5"])
    other = untrained_run(tmp_path / "other", trained_stems=["99"])
    out = tmp_path / "out"
    written(tiny_route, out, seen=seen, other=other)
    told = json.loads((out / "metrics.json").read_text())["methods"]
    assert {label: one["trained_places_tested"] for label, one in told.items()} == {"seen": 3, "other": 0}
    said = "3 of the tested places carry the names of places that seen was trained on or chosen by: if it is the same "
    for place in ((out / "table.md").read_text("utf-8"), visible(out)):
        assert said in place
        assert "that other was trained" not in place


def test_a_bar_in_a_name_begins_no_cell(tiny_route: Path, tmp_path: Path) -> None:
    comparison = written(tiny_route, tmp_path / "out", **{"a|b": "sad"})
    header, _ = comparison.table()
    rows = [line for line in (tmp_path / "out" / "table.md").read_text("utf-8").splitlines() if "b |" in line]
    assert len(rows) == 2
    for row in rows:
        assert row.startswith("| a\\|b | ")
        assert row.count(" |") == len(header)


def test_nothing_is_written_while_another_process_writes(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locking, "_SECONDS_TO_LET_GO", 0.2)
    out = tmp_path / "out"
    comparison = written(tiny_route, out, sad="sad")
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    with locked(out), pytest.raises(ConfigError, match="is being written by another process"):
        write_comparison(comparison, out, title="another", details={})
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


@pytest.mark.slow
def test_pictures_of_a_model_that_is_no_longer_compared_are_removed(tiny_route: Path, tmp_path: Path) -> None:
    run, out = untrained_run(tmp_path / "run", "c-vae"), tmp_path / "out"
    written(tiny_route, out, run=run, sad="sad")
    assert {path.name for path in out.glob("run-*")} == {"run-swap.png", "run-constant.png", "run-translation.png"}
    (out / "run-mine.png").write_bytes(b"")
    written(tiny_route, out, sad="sad")
    assert [path.name for path in out.glob("run-*")] == ["run-mine.png"]


@pytest.mark.parametrize(
    ("matching", "symmetric"),
    [
        (Matching(), "sad, hog"),
        (Matching("centre"), "sad, hog"),
        (Matching(sequence=3), ""),
        (Matching(sequence=3, sequence_method="seqslam"), ""),
    ],
)
def test_tables_say_why_a_score_is_the_same_in_both_directions(
    tiny_route: Path, tmp_path: Path, matching: Matching, symmetric: str
) -> None:
    study = open_study(open_route(tiny_route), MatchRule(), matching)
    comparison = compare_methods(study, Methods({name: open_describer(name) for name in ("sad", "hog")}), tmp_path)
    write_comparison(comparison, tmp_path, title="c", details={})
    for text in ((tmp_path / "table.md").read_text("utf-8"), visible(tmp_path)):
        assert ("is the same in both directions" in text) is bool(symmetric)
        assert f"AP of {symmetric} is the same in both directions of a pair" in text or not symmetric


def test_thresholds_stand_with_every_pair(finished: Path) -> None:
    out = finished / "c"
    pairs = json.loads((out / "metrics.json").read_text())["pairs"]
    tables = [one["precision_table"] for pair in pairs for one in pair["methods"].values()]
    assert len(tables) == 4
    for table in tables:
        assert list(table) == ["90", "95", "99", "100"]
        assert set(table["99"]) == {"threshold", "recall", "recall_interval", "accepted", "wrong"}
    said = [one["good_enough_for"] for pair in pairs for one in pair["methods"].values()]
    written_here = (out / "table.md").read_text("utf-8")
    assert sum(f": {sentence}" in written_here for sentence in said) >= 2
    assert visible(out).count("is accepted. The interval of the recall") == 4  # a caption of each pair, and its label
