"""How a table names what a run has that the paper's model has not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["ingredient_metrics", "named_ingredients"]

_FAITHFUL = "faithful"
_INGREDIENTS = ("recipe", "remedies")
"""Where a run's settings say them; see `everplace.model.checkpoint.Checkpoint.settings`."""


def named_ingredients(settings: Mapping[str, Any]) -> str | None:
    """What of a run's recipe must be said wherever its scores stand.

    Args:
        settings: Those of a describer, or what else holds a run's `recipe` and `remedies`.

    Returns:
        A part of a sentence, such as "recipe best; remedies: no fully connected chain"; None for a faithful run without
        remedies and for a method that has no recipe.
    """
    recipe, remedies = (str(settings.get(name) or "") for name in _INGREDIENTS)
    named = f"recipe {recipe}" if recipe else ""
    if remedies:
        return f"{named}; remedies: {remedies}".removeprefix("; ")
    return named if recipe not in ("", _FAITHFUL) else None


def ingredient_metrics(settings: Mapping[str, Any]) -> dict[str, str]:
    """Recipe and remedies of a run as metrics.json says them; empty for a method that has no recipe."""
    return {name: str(settings[name]) for name in _INGREDIENTS if name in settings}
