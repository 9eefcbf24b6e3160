"""A small rendered route that the tests of learning share."""

from __future__ import annotations

from pathlib import Path

import pytest

from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

PLACES = 120


@pytest.fixture(scope="session")
def rendered_route(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """120 places in summer and winter; nobody may change it."""
    out = tmp_path_factory.mktemp("rendered") / "route"
    world = {"places": PLACES, "size": (32, 64), "conditions": ("summer", "winter"), "seed": 3}
    render_route(out, render_config(world))
    return out
