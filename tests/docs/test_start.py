"""The start page and the README say of the demo what it does."""

from __future__ import annotations

from pathlib import Path

import pytest

from everplace.experiments.rendered_demo import MODELS

ROOT = Path(__file__).parents[2]
NUMBERS = ("no", "one", "two", "three", "four", "five")


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_models_of_the_demo_are_counted(page: str) -> None:
    assert f"trains {NUMBERS[len(MODELS)]} models" in (ROOT / page).read_text(encoding="utf-8")


def test_the_models_of_the_demo_are_named() -> None:
    text = " ".join((ROOT / "docs" / "index.md").read_text(encoding="utf-8").split())
    listed = text.partition(" models on its first part (")[2].partition(")")[0]
    named = [f"{model['model'].upper()}{recipe(model)}" for model in MODELS.values()]
    assert listed == f"{', '.join(named[:-1])}, and {named[-1]}"


def recipe(model: dict[str, str]) -> str:
    return f" with `--recipe {model['recipe']}`" if "recipe" in model else ""
