"""A run that is not the paper's model is named so."""

from __future__ import annotations

from typing import Any

import pytest

from everplace.describe.registry import open_describer
from everplace.experiments.recipe_names import named_method, named_recipe, recipe_metrics
from everplace.training.config import TrainConfig


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"recipe": "best", "remedies": "free bits (2 nats)"}, "recipe best; remedies: free bits (2 nats)"),
        ({"recipe": "best", "remedies": ""}, "recipe best"),
        ({"recipe": "faithful", "remedies": "free bits"}, "recipe faithful; remedies: free bits"),
        ({"remedies": "free bits"}, "remedies: free bits"),
        ({"recipe": "faithful", "remedies": ""}, None),
        ({"recipe": "faithful"}, None),
        ({}, None),
    ],
)
def test_all_but_a_faithful_run_is_named(settings: dict[str, str], said: str | None) -> None:
    assert named_recipe(settings) == said
    assert recipe_metrics({**settings, "seed": 3}) == settings


def test_a_method_without_a_recipe_is_not_named() -> None:
    settings = open_describer("hog").settings()
    assert named_recipe(settings) is None
    assert recipe_metrics(settings) == {}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "run"),
        ({"recipe": "best"}, "run (recipe best)"),
        ({"fully_connected": False}, "run (no fully connected chain)"),
        ({"recipe": "best", "fully_connected": False}, "run (recipe best)"),
        ({"recipe": "best", "projection": {"ridge": 9.0}}, "run (recipe best, z_p from oriented gradients)"),
    ],
)  # fmt: skip
def test_a_picture_names_the_recipe_and_what_it_does_not_bring(given: dict[str, Any], said: str) -> None:
    config = TrainConfig.build(model="cp-vae", epochs=1, **given)
    settings = {"recipe": config.recipe, "remedies": ", ".join(config.remedies_in_use())}
    assert named_method("run", settings) == said


def test_a_picture_of_a_recipe_from_elsewhere_is_named_too() -> None:
    assert named_method("onnx", {"recipe": "mine"}) == "onnx (recipe mine)"
    assert named_method("hog", open_describer("hog").settings()) == "hog"
