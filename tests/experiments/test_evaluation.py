"""What an evaluation says of the method beside its scores."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape
from numpy.typing import NDArray
from PIL import Image

from everplace.experiments.evaluation import Evaluation, evaluate_retrieval
from everplace.experiments.evaluation_report import write_evaluation
from everplace.experiments.manifest import DEFINITIONS
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.route.route import open_route
from everplace.scoring.precision_table import good_enough_for, precision_table
from everplace.scoring.retrieval import MatchRule, retrieve
from everplace.training.config import TrainConfig, write_config

PLACES = 6


@pytest.fixture(scope="module")
def route(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Noise in two conditions, with a pose every ten metres."""
    root = tmp_path_factory.mktemp("route")
    for number, name in enumerate(("day", "night")):
        (root / name).mkdir()
        rng = np.random.default_rng(number)
        for place in range(PLACES):
            Image.fromarray(rng.integers(0, 256, (32, 32), dtype=np.uint8)).save(root / name / f"{place}.png")
        poses = "".join(f"{place},{10.0 * place},0,0\n" for place in range(PLACES))
        (root / name / "poses.csv").write_text(f"stem,x,y,heading\n{poses}")
    return root


def evaluated(route: Path, run: Path, about: dict[str, str], truth: MatchRule) -> Evaluation:
    """An untrained network, whose checkpoint says this of itself, between the two conditions."""
    settings = {"kind": "cp-vae", "height": 32, "width": 32, "channels": 1, "conditions": ("day", "night")}
    config = ModelConfig.model_validate({**settings, "places": 3, "fully_connected": False})
    save_checkpoint(run, ConditionVAE(config), about)
    write_config(run, TrainConfig.build(model="cp-vae", epochs=1))
    result = retrieve(open_route(route), "day", "night", run, tolerance=truth.tolerance, radius=truth.radius)
    return evaluate_retrieval(result, str(run))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("about", "named"),
    [
        ({"recipe": "best", "remedies": "free bits"}, "model alone: recipe best; remedies: free bits."),
        ({"recipe": "faithful", "remedies": ""}, None),
    ],
)
def test_recipe_and_remedies_are_named(route: Path, tmp_path: Path, about: dict[str, str], named: str | None) -> None:
    write_evaluation(evaluated(route, tmp_path / "run", about, MatchRule(tolerance=2)), tmp_path, details={})
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    page = (tmp_path / "report.html").read_text()
    assert {key: metrics[key] for key in about} == about
    assert ("This run is not the paper" in page) is (named is not None)
    assert named is None or named in page
    assert "retrieval counts a match within ±2 places as right" in page
    # The title of the page, the curve and the audit's pictures say so too.
    label = "cp-vae (recipe best, free bits)" if named is not None else "cp-vae"
    assert f"<h1>{label}: query day, database night</h1>" in page
    assert f'<th scope="col">{label}</th>' in page
    assert f'"name":"{label}' in page
    assert f"{label}: whether the latent is alive" in page


@pytest.mark.slow
def test_the_report_says_how_it_was_measured(route: Path, tmp_path: Path) -> None:
    run = tmp_path / "runs" / "mine"
    write_evaluation(evaluated(route, run, {"recipe": "best"}, MatchRule(tolerance=2)), tmp_path, details={})
    page = (tmp_path / "report.html").read_text()
    assert f"<dt>method</dt><dd>{run}</dd>" in page
    section = page[page.index('<section id="how-it-was-measured"') :]
    section = section[: section.index("</section>")]
    for said in (
        f"{run} (cp-vae, recipe best)",
        f"Each of the {PLACES} frames of the query day asks the whole database night, {PLACES} frames.",
        "A proposed frame counts as right within ±2 frames.",
        "descriptors compared as they are; score: cosine similarity",
        "mean of the precision at the lowest recall and recall at 100 % precision.",
        *(DEFINITIONS[name] for name in ("curve", "recall@N", "auc_pr", "AP", "R@100%P", "dimension", "ms/image")),
    ):
        assert escape(said) in section
    assert "match plain" not in page


@pytest.mark.slow
def test_pictures_of_an_earlier_method_do_not_stay(route: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    latent = {"swap.png", "constant.png", "translation.png"}
    for name in latent:  # not written by an evaluation, so not removed by one
        out.mkdir(exist_ok=True)
        (out / name).write_bytes(b"mine")
    hog = evaluate_retrieval(retrieve(open_route(route), "day", "night", "hog", tolerance=1), "hog")
    write_evaluation(hog, out, details={})
    assert {(out / name).read_bytes() for name in latent} == {b"mine"}
    write_evaluation(evaluated(route, tmp_path / "run", {}, MatchRule(tolerance=1)), out, details={})
    assert latent < {path.name for path in out.iterdir()}
    write_evaluation(hog, out, details={})
    assert not latent & {path.name for path in out.iterdir()}


@pytest.mark.parametrize(("truth", "within"), [(MatchRule(tolerance=2), 2), (MatchRule(radius=25.0), 1)])
def test_the_audit_says_what_it_counts_as_right(route: Path, tmp_path: Path, truth: MatchRule, within: int) -> None:
    assert evaluated(route, tmp_path, {}, truth).metrics()["audit"]["tolerance"] == within


def test_traverse_and_condition_are_both_told(route: Path, tmp_path: Path) -> None:
    copy = tmp_path / "route"
    shutil.copytree(route, copy)
    (copy / "route.toml").write_text('[traverses.day]\ncondition = "sun"\n[traverses.night]\ncondition = "dark"\n')
    metrics = evaluate_retrieval(retrieve(open_route(copy), "sun", "night", "sad", tolerance=1), "sad").metrics()
    assert (metrics["query_traverse"], metrics["database_traverse"]) == ("day", "night")
    assert (metrics["query_condition"], metrics["database_condition"]) == ("sun", "dark")


@pytest.mark.parametrize("method", ["hog", "sad"])
def test_thresholds_are_told_by_the_metrics_and_the_report(tiny_route: Path, tmp_path: Path, method: str) -> None:
    evaluation = evaluate_retrieval(retrieve(open_route(tiny_route), "winter", "summer", method), method)
    write_evaluation(evaluation, tmp_path / "out", details={})
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    table = precision_table(evaluation.result.similarity, truth_of(evaluation))
    assert list(metrics["precision_table"]) == ["90", "95", "99", "100"]
    for name, row in metrics["precision_table"].items():
        assert (row["threshold"], row["recall"]) == (table[name].threshold, table[name].recall)
        assert row["recall_interval"] == list(table[name].recall_interval)
    assert metrics["good_enough_for"] == good_enough_for(table)
    assert "12 accepted matches are too few to tell" in metrics["good_enough_for"]
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert f"<p>{method}: {escape(good_enough_for(table))}</p>" in page
    assert '<th scope="row">99 %</th>' in page


def truth_of(evaluation: Evaluation) -> NDArray[np.bool_]:
    truth = evaluation.result.truth
    assert truth is not None
    return truth
