"""A small world that the tests of the renderer share."""

from __future__ import annotations

import pytest

from everplace.render.render_config import RenderConfig
from everplace.render.rendered_route import route_world
from everplace.render.world import World

CONFIG = RenderConfig(places=40, seed=5)


@pytest.fixture(scope="session")
def config() -> RenderConfig:
    return CONFIG


@pytest.fixture(scope="session")
def world() -> World:
    return route_world(CONFIG)
