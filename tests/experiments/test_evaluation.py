"""What an evaluation says of the method beside its scores."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.data.route import open_route
from everplace.data.selection import Selection
from everplace.experiments.evaluation import evaluate_method, write_evaluation
from everplace.experiments.retrieval import Matching, Truth
from everplace.model.architecture import ConditionVAE
from everplace.model.checkpoint import save_checkpoint
from everplace.model.config import ModelConfig
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


def evaluated(route: Path, out: Path, about: dict[str, str], truth: Truth) -> tuple[dict[str, Any], str]:
    """Metrics and page of an untrained network whose checkpoint says this of itself."""
    settings = {"kind": "cp-vae", "height": 32, "width": 32, "channels": 1, "conditions": ("day", "night")}
    config = ModelConfig.model_validate({**settings, "places": 3, "fully_connected": False})
    save_checkpoint(out / "run", ConditionVAE(config), about)
    write_config(out / "run", TrainConfig.build(model="cp-vae", epochs=1))
    evaluation = evaluate_method(
        open_route(route), str(out / "run"), query="day", database="night", selection=Selection(), truth=truth,
        matching=Matching(),
    )  # fmt: skip
    write_evaluation(evaluation, out / "result", details={})
    return json.loads((out / "result" / "metrics.json").read_text()), (out / "result" / "report.html").read_text()


def test_recipe_and_remedies_are_named(route: Path, tmp_path: Path) -> None:
    about = {"recipe": "best", "remedies": "z_p from oriented gradients; free bits"}
    metrics, page = evaluated(route, tmp_path, about, Truth(tolerance=1))
    assert {key: metrics[key] for key in about} == about
    assert "not the paper&#x27;s model alone: recipe best; remedies: z_p from oriented gradients; free bits." in page


def test_a_faithful_run_is_the_paper_s(route: Path, tmp_path: Path) -> None:
    metrics, page = evaluated(route, tmp_path, {"recipe": "faithful", "remedies": ""}, Truth(tolerance=1))
    assert metrics["recipe"] == "faithful"
    assert metrics["remedies"] == ""
    assert "the paper&#x27;s model alone" not in page


@pytest.mark.parametrize(("truth", "within"), [(Truth(tolerance=2), 2), (Truth(radius=25.0), 1)])
def test_the_audit_says_what_it_counts_as_right(route: Path, tmp_path: Path, truth: Truth, within: int) -> None:
    metrics, page = evaluated(route, tmp_path, {}, truth)
    assert metrics["audit"]["tolerance"] == within
    assert f"retrieval counts a match within ±{within} places as right" in page
