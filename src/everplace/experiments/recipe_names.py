"""How a table names what a run has that the paper's model has not."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from everplace.training.config import TrainConfig

__all__ = ["named_method", "named_recipe", "recipe_metrics"]

_FAITHFUL = "faithful"
_BEST = "best"
_KEYS = ("recipe", "remedies")
"""Where a run's settings say them; see `everplace.model.checkpoint.Checkpoint.settings`."""


def named_recipe(settings: Mapping[str, Any]) -> str | None:
    """What of a run's recipe must be said wherever its scores stand.

    Args:
        settings: Those of a describer, or what else holds a run's `recipe` and `remedies`.

    Returns:
        A part of a sentence, such as "recipe best; remedies: no fully connected chain"; None for a faithful run without
        remedies and for a method that has no recipe.
    """
    recipe, remedies = (str(settings.get(name) or "") for name in _KEYS)
    named = f"recipe {recipe}" if recipe else ""
    if remedies:
        return f"{named}; remedies: {remedies}".removeprefix("; ")
    return named if recipe not in ("", _FAITHFUL) else None


def named_method(name: str, settings: Mapping[str, Any]) -> str:
    """Names a method in a picture, where there is no room for all that `named_recipe` says.

    Args:
        name: The method's name, or the label of its run.
        settings: See `named_recipe`.

    Returns:
        The name, with the recipe unless it is the faithful one, and with the remedies that the recipe does not bring,
        without their numbers: "cp-vae (recipe best)", "cp-vae (no fully connected chain)".
    """
    recipe, remedies = (str(settings.get(key) or "") for key in _KEYS)
    # A comma within brackets stands between the numbers of one remedy.
    used = re.split(r", (?![^(]*\))", remedies) if remedies else []
    brought = TrainConfig.build(model="cp-vae", recipe=_BEST, epochs=1).remedies_in_use() if recipe == _BEST else []
    said = [f"recipe {recipe}"] if recipe not in ("", _FAITHFUL) else []
    said += [re.sub(r" \([^()]*\)", "", one) for one in used if one not in brought]
    return f"{name} ({', '.join(said)})" if said else name


def recipe_metrics(settings: Mapping[str, Any]) -> dict[str, str]:
    """Recipe and remedies of a run as metrics.json says them; empty for a method that has no recipe."""
    return {name: str(settings[name]) for name in _KEYS if name in settings}
