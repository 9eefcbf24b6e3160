"""A small world that the tests of the renderer share."""

from __future__ import annotations

import pytest

from everplace.data.render.config import RenderConfig
from everplace.data.render.route import route_world
from everplace.data.render.world import World

CONFIG = RenderConfig(places=40, seed=5)


@pytest.fixture(scope="session")
def config() -> RenderConfig:
    return CONFIG


@pytest.fixture(scope="session")
def world() -> World:
    return route_world(CONFIG)
