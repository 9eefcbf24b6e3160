"""A run that is not the paper's model is named so."""

from __future__ import annotations

import pytest

from everplace.describe.registry import open_describer
from everplace.experiments.ingredients import ingredient_metrics, named_ingredients


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
    assert named_ingredients(settings) == said
    assert ingredient_metrics({**settings, "seed": 3}) == settings


def test_a_method_without_a_recipe_is_not_named() -> None:
    settings = open_describer("hog").settings()
    assert named_ingredients(settings) is None
    assert ingredient_metrics(settings) == {}
