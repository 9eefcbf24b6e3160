"""The world of one seed: road, land and everything on it, the same under every condition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.render.mesh import Mesh
from everplace.render.noise import tile
from everplace.render.planner import Plants
from everplace.render.road import Road, make_road
from everplace.render.scenery import plan_scenery
from everplace.render.terrain import Terrain

__all__ = ["World", "make_world"]


@dataclass(frozen=True, slots=True)
class World:
    """Geometry only: nothing here knows the condition.

    Attributes:
        seed: The seed it was made from.
        road: The road and its stretches.
        terrain: The land.
        plants: Trees and bushes that stand alone.
        mesh: Everything built.
        grain: Noise tile for textures of ground and sky.
    """

    seed: int
    road: Road
    terrain: Terrain
    plants: Plants
    mesh: Mesh
    grain: NDArray[np.float32]


def make_world(seed: int, length: float) -> World:
    """Makes the world of a seed.

    Args:
        seed: Chooses everything.
        length: Metres of road, from x = 0 on, along which a camera will drive.
    """
    rng = np.random.default_rng([seed, 0])
    hills, detail, grain = tile(rng, 8, 4), tile(rng, 32, 4), tile(rng, 8, 6)
    road = make_road(rng, length)
    terrain = Terrain(road, hills, detail)
    plants, mesh = plan_scenery(rng, road, terrain)
    return World(seed, road, terrain, plants, mesh, grain)
