"""Several methods on all ordered pairs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from everplace.describe import methods
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, MethodError, RouteError
from everplace.experiments.comparison import compare_methods
from everplace.experiments.comparison_methods import Methods, fit_and_open, select_tested
from everplace.experiments.comparison_report import write_comparison
from everplace.experiments.manifest import open_study
from everplace.match.matching import Matching
from everplace.route.route import open_route
from everplace.route.selection import Selection, parse_frames
from everplace.scoring.retrieval import MatchRule
from everplace.training.fitted_methods import build_config, fit_method


def test_every_ordered_pair_and_method_is_there(tiny_route: Path, tmp_path: Path) -> None:
    describers = {name: open_describer(name) for name in ("sad", "hog")}
    study = open_study(open_route(tiny_route), MatchRule(0), Matching())
    comparison = compare_methods(study, Methods(describers), tmp_path / "out")
    assert set(comparison.results) == {("summer", "winter"), ("winter", "summer")}
    assert all(set(results) == {"sad", "hog"} for results in comparison.results.values())
    out = tmp_path / "out"
    write_comparison(comparison, out, title="a <b>", details={"command": "x"})
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["tolerance"] == 0
    first = metrics["pairs"][0]["methods"]["hog"]
    expected = comparison.results[metrics["pairs"][0]["query"], metrics["pairs"][0]["database"]]["hog"]
    assert first["auc_pr"] == expected.scores.auc_pr
    areas = [pair["methods"]["hog"]["auc_pr"] for pair in metrics["pairs"]]
    assert metrics["mean_auc_pr"]["hog"] == pytest.approx(sum(areas) / 2)
    page = (out / "report.html").read_text()
    assert "a &lt;b&gt;" in page
    assert f"| hog | {first['recall_at']['1']:.3f} |" in (out / "table.md").read_text()


def test_one_traverse_is_no_comparison(tiny_route: Path) -> None:
    route = open_route(tiny_route).choose(["summer"])
    with pytest.raises(RouteError, match="two traverses"):
        open_study(route, MatchRule(), Matching())


def test_a_peak_that_cannot_be_measured_is_a_dash_with_its_reason(tiny_route: Path, tmp_path: Path) -> None:
    study = open_study(open_route(tiny_route), MatchRule(), Matching())
    methods = Methods({"hog": open_describer("hog")}, {"hog": str(tmp_path / "gone")})
    for _ in range(2):  # measured, and read
        comparison = compare_methods(study, methods, tmp_path)
        assert comparison.metrics()["pairs"][0]["methods"]["hog"]["peak_memory_mb"] is None
        assert "gone" in comparison.notes[0]
    write_comparison(comparison, tmp_path, title="c", details={})
    table = (tmp_path / "table.md").read_text()
    assert table.count(" | \N{EN DASH} |") == 2
    assert comparison.notes[0] in table


@pytest.fixture
def weightless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A method whose weights are absent, added as methods are: by one file."""
    (tmp_path / "methods").mkdir()
    (tmp_path / "methods" / "weightless.py").write_text(
        "from everplace.errors import MethodError\n"
        "def open_method(argument):\n"
        "    raise MethodError('weightless needs weights.pth; fetch it first')\n"
    )
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path / "methods")])
    return "weightless"


def test_a_method_that_cannot_run_is_left_out_with_its_reason(
    tiny_route: Path, tmp_path: Path, weightless: str
) -> None:
    ready = fit_and_open(open_route(tiny_route), ["hog", weightless], "", tmp_path / "out", settings={})
    assert list(ready.describers) == ["hog"]
    assert ready.sources == {"hog": "hog"}
    assert ready.left_out == {"weightless": "weightless needs weights.pth; fetch it first"}


def test_methods_none_of_which_can_run_are_an_error(tiny_route: Path, tmp_path: Path, weightless: str) -> None:
    with pytest.raises(ConfigError, match="none of them"):
        fit_and_open(open_route(tiny_route), [weightless], "", tmp_path / "out", settings={})


def test_a_misspelt_method_is_an_error(tiny_route: Path, tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="nonesuch"):
        fit_and_open(open_route(tiny_route), ["hog", "nonesuch"], "", tmp_path / "out", settings={})


@pytest.mark.parametrize(
    ("fit", "test", "says"),
    [
        ("", "6:", "`fit_frames`"),
        ("0:8", "6:", "share 2 places"),
        ("30:40", "6:", "`fit_frames` 30:40 holds no place, as .*tiny has only 12; begin lower"),
        ("4-9", "6:", "`fit_frames` '4-9' is not A:B"),
        ("4:2", "6:", "`fit_frames` '4:2' holds no place"),
        ("9" * 5000 + ":", "6:", "`fit_frames` holds a number"),
    ],
)
def test_a_model_is_not_fitted_on_tested_places(tiny_route: Path, fit: str, test: str, says: str) -> None:
    selection = Selection(parse_frames(test))
    with pytest.raises(ConfigError, match=says):
        select_tested(open_route(tiny_route), ["vae"], selection, fit)


def test_a_model_is_fitted_on_the_other_places(tiny_route: Path, tmp_path: Path) -> None:
    config = {"epochs": 1, "image_size": (32, 32), "held_out_gap": 0, "batch_size": 4, "fully_connected": False}
    route = open_route(tiny_route)
    tested = select_tested(route, ["cp-vae"], Selection(slice(8, None)), "0:8")
    assert [len(traverse) for traverse in tested.traverses] == [4, 4]
    ready = fit_and_open(route, ["cp-vae"], "0:8", tmp_path / "out", settings=config)
    assert ready.describers["cp-vae"].dimension == 96
    assert ready.sources == {"cp-vae": str(tmp_path / "out" / "runs" / "cp-vae")}
    assert (tmp_path / "out" / "runs" / "cp-vae" / "checkpoint.json").is_file()


@pytest.mark.slow
def test_the_words_of_fabmap_have_new_places_and_are_not_centred(tiny_route: Path, tmp_path: Path) -> None:
    route = open_route(tiny_route)
    with pytest.raises(ConfigError, match="too few for words = 1500"):  # 16 smooth frames of 32×64
        fit_and_open(route, ["fabmap"], "0:8", tmp_path / "few", settings={})
    fit_method(route, build_config(model="fabmap", frames="0:8", words=20, smallest_side=256), tmp_path / "words")
    describers = {"words": open_describer(str(tmp_path / "words")), "hog": open_describer("hog")}
    tested = select_tested(route, ["hog"], Selection(slice(8, None)), "0:8")
    plain = compare_methods(open_study(tested, MatchRule(1), Matching()), Methods(describers), tmp_path / "plain")
    first = plain.metrics()["pairs"][0]["methods"]
    assert set(first["words"]["new_place"]) == {"mean_probability", "above_half"}
    assert "new_place" not in first["hog"]

    study = open_study(tested, MatchRule(1), Matching("centre"))
    methods = Methods(describers, left_out={"x": "absent"})
    centred = compare_methods(study, methods, tmp_path / "centred")
    assert set(centred.describers) == {"hog"}
    assert centred.left_out["x"] == "absent"
    assert "`standardise` centre does not apply to the words of fabmap" in centred.left_out["words"]
    with pytest.raises(ConfigError, match="`standardise` centre does not apply"):
        compare_methods(study, Methods({"words": describers["words"]}), tmp_path / "words-alone")


@pytest.mark.slow
def test_the_fitted_baselines_stand_beside_the_others(tiny_route: Path, tmp_path: Path) -> None:
    # FAB-MAP takes from the settings of the networks what it has too.
    config = {
        "epochs": 1, "image_size": (32, 32), "held_out_gap": 0, "batch_size": 4, "fully_connected": False, "seed": 3,
    }  # fmt: skip
    methods = ["cae", "fabmap", "hog"]
    route = open_route(tiny_route)
    with pytest.raises(ConfigError, match="too few for words = 1500"):
        fit_and_open(route, ["fabmap"], "0:8", tmp_path / "few", settings=config)
    fit_method(
        route, build_config(model="fabmap", frames="0:8", seed=3, words=20, smallest_side=256), tmp_path / "words"
    )
    methods[1] = str(tmp_path / "words")
    tested = select_tested(route, methods, Selection(slice(8, None)), "0:8")
    ready = fit_and_open(route, methods, "0:8", tmp_path / "out", settings=config)
    assert {label: one.metric for label, one in ready.describers.items()} == {
        "cae": "cosine", "words": "place-posterior", "hog": "cosine",
    }  # fmt: skip
    comparison = compare_methods(open_study(tested, MatchRule(1), Matching()), ready, tmp_path / "plain")
    metrics = comparison.metrics()
    first = metrics["pairs"][0]["methods"]
    assert set(first["words"]["new_place"]) == {"mean_probability", "above_half"}
    assert "new_place" not in first["hog"]
    assert not comparison.audits  # neither has a z_p and a z_c
    write_comparison(comparison, tmp_path / "report", title="all", details={})
    assert (tmp_path / "report" / "report.html").is_file()

    study = open_study(tested, MatchRule(1), Matching("centre"))
    unmeasured = replace(ready, left_out={"x": "absent"}, sources={})
    centred = compare_methods(study, unmeasured, tmp_path / "centred")
    assert set(centred.describers) == {"cae", "hog"}
    assert centred.left_out["x"] == "absent"
    assert "`standardise` centre does not apply to the words of fabmap" in centred.left_out["words"]
    with pytest.raises(ConfigError, match="`standardise` centre does not apply"):
        compare_methods(study, Methods({"words": ready.describers["words"]}), tmp_path / "words-alone")
