"""Recipes: the defaults of a run that depend on the kind of model."""

from __future__ import annotations

from typing import Any

from everplace.errors import ConfigError

__all__ = ["recipe"]


def recipe(model: str, name: str) -> dict[str, Any]:
    """The defaults of a recipe for a kind of model.

    Raises:
        ConfigError: There is no recipe of that name.
    """
    if name not in ("faithful", "best"):
        raise ConfigError(f"--recipe {name!r} does not exist; choose faithful or best")
    if name == "best" and model != "cp-vae":
        raise ConfigError(f"--recipe best is a recipe of cp-vae, not of {model}; choose faithful")
    defaults: dict[str, Any] = {
        "recipe": name,
        "batch_size": 64,
        "weight_decay": 0.1,
        "augmentation": {"shift": 0.03, "crop": 0.03, "brightness": 0.18, "contrast": 0.35},
    }
    if model == "c-vae":
        defaults["weights"] = {"condition": 100.0}
    if model == "cp-vae":
        defaults["weights"] = {"condition": 100.0, "place": 5000.0}
    return {**defaults, **_BEST} if name == "best" else defaults


_BEST: dict[str, Any] = {
    "oriented_gradients": True,
    "fully_connected": False,
    "fully_connected_rate": 1.0,
}
