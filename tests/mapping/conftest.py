"""A small rendered route that the tests of learning share."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.conftest import MadeOnce

from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

PLACES = 120


@pytest.fixture(scope="session")
def rendered_route(made_once: MadeOnce) -> Path:
    """120 places in summer and winter; nobody may change it."""
    world = {"places": PLACES, "size": (32, 64), "conditions": ("summer", "winter"), "seed": 3}
    return made_once("route", lambda path: render_route(path, render_config(world)))
