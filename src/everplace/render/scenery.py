"""Where everything stands: plants, buildings, poles, fences and signs along the stretches of the road."""

from __future__ import annotations

import numpy as np

from everplace.render import buildings
from everplace.render.mesh import Mesh
from everplace.render.planner import Planner, Plants
from everplace.render.road import WOODS, Biome, Road, Segment
from everplace.render.roadside import furnish
from everplace.render.sprites import Plant
from everplace.render.terrain import Terrain

__all__ = ["plan_scenery"]


def plan_scenery(rng: np.random.Generator, road: Road, terrain: Terrain) -> tuple[Plants, Mesh]:
    """Plans everything that stands along the road.

    Args:
        rng: Source of all choices.
        road: The road and its stretches.
        terrain: The land to stand on.
    """
    planner = Planner(rng, road, terrain)
    for segment in road.segments:
        for side, biome in segment.sides:
            _plan_side(planner, segment, side, biome)
    furnish(planner)
    return planner.plants(), planner.mesh.build(rng)


def _plan_side(planner: Planner, segment: Segment, side: int, biome: Biome) -> None:
    if biome in WOODS:
        _forest(planner, segment, side, biome)
    elif biome == Biome.VILLAGE:
        _village(planner, segment, side)
    elif biome == Biome.FARM:
        _farm(planner, segment, side)
    elif biome == Biome.ORCHARD:
        for x in np.arange(segment.start, segment.end, 7.5):
            for away in np.arange(11, 48, 7.5):
                planner.plant(Plant.FRUIT, x + planner.rng.uniform(-0.5, 0.5), side * away)
    elif biome == Biome.LAKE:
        for x, away in planner.scatter(segment, 0.22, 8.5, 13):
            planner.plant(Plant.BUSH, x, side * away, 0.7)
        for x, away in planner.scatter(segment, 0.03, 9, 14):
            planner.plant(Plant.BIRCH, x, side * away)
    else:
        _open_land(planner, segment, side, biome)


def _forest(planner: Planner, segment: Segment, side: int, biome: Biome) -> None:
    conifers = 0.9 if biome == Biome.CONIFERS else 0.25
    for x, away in planner.scatter(segment, 0.62, 9, 31):
        if planner.rng.random() < conifers:
            kind = Plant.CONIFER
        else:
            kind = Plant.BIRCH if planner.rng.random() < 0.3 else Plant.BROADLEAF
        planner.plant(kind, x, side * away, min(1.0, 0.55 + away / 50))
    for x, away in planner.scatter(segment, 0.3, 23, 29):  # the forest's edge, in front of the closed canopy
        planner.plant(Plant.CONIFER if planner.rng.random() < conifers else Plant.BROADLEAF, x, side * away)
    for x, away in planner.scatter(segment, 0.12, 7.5, 11):
        planner.plant(Plant.BUSH, x, side * away)


def _village(planner: Planner, segment: Segment, side: int) -> None:
    rng = planner.rng
    x = segment.start + rng.uniform(4, 14)
    church = rng.uniform(segment.start + 30, segment.end - 10) if side > 0 else -1e9
    while x < segment.end - 8:
        if abs(x - church) < 16:
            buildings.church(planner.site(x, side * 27.0, rng.choice([0, np.pi])))
            church = -1e9
            x += 22
        turn = rng.choice([0.0, np.pi / 2, np.pi]) + rng.uniform(-0.08, 0.08)
        buildings.house(planner.site(x, side * rng.uniform(13, 17), turn), rng)
        if rng.random() < 0.6:
            turn = rng.uniform(0, 2 * np.pi)
            buildings.house(planner.site(x + 6, side * rng.uniform(34, 52), turn), rng)
        x += rng.uniform(17, 27)
    for x, away in planner.scatter(segment, 0.10, 8, 45):
        planner.plant(Plant.FRUIT if rng.random() < 0.5 else Plant.BROADLEAF, x, side * away, 0.8)
    for x, away in planner.scatter(segment, 0.12, 7.0, 9.5):
        planner.plant(Plant.BUSH, x, side * away, 0.7)


def _farm(planner: Planner, segment: Segment, side: int) -> None:
    rng = planner.rng
    x = rng.uniform(segment.start + 20, segment.end - 20)
    buildings.barn(planner.site(x, side * rng.uniform(24, 34), rng.uniform(-0.6, 0.6)), rng)
    buildings.house(planner.site(x + 26, side * 22.0, rng.uniform(-0.2, 0.2)), rng)
    for step in range(rng.integers(0, 3)):
        buildings.silo(planner.site(x - 18 - 6 * step, side * 30.0), rng)
    if rng.random() < 0.3:
        buildings.water_tower(planner.site(x - 40, side * 70.0))
    for px, away in planner.scatter(segment, 0.06, 12, 60):
        planner.plant(Plant.BROADLEAF if rng.random() < 0.6 else Plant.FRUIT, px, side * away)


def _open_land(planner: Planner, segment: Segment, side: int, biome: Biome) -> None:
    rng = planner.rng
    kinds = [Plant.BROADLEAF, Plant.POPLAR, Plant.BIRCH, Plant.CONIFER]
    for x, away in planner.scatter(segment, 0.035 if biome == Biome.MEADOW else 0.015, 10, 110):
        planner.plant(kinds[rng.integers(4)], x, side * away)
    for x, away in planner.scatter(segment, 0.06, 8, 60):
        planner.plant(Plant.BUSH, x, side * away)
    choice = rng.random()
    if choice < 0.28:  # an avenue
        kind = Plant.POPLAR if rng.random() < 0.5 else Plant.BROADLEAF
        spacing = rng.uniform(10, 18)
        for x in np.arange(segment.start, segment.end, spacing):
            planner.plant(kind, x, side * 7.8, 0.85)
    elif choice < 0.55:  # hedges that lead away from the road
        for _ in range(rng.integers(1, 4)):
            x = rng.uniform(segment.start, segment.end)
            for away in np.arange(11, 75, 2.2):
                planner.plant(Plant.BUSH, x + rng.uniform(-0.6, 0.6), side * away)
    elif choice < 0.7:  # a copse
        x, away = rng.uniform(segment.start, segment.end), rng.uniform(30, 60)
        for _ in range(22):
            kind = Plant.CONIFER if rng.random() < 0.4 else Plant.BROADLEAF
            planner.plant(kind, x + rng.normal(0, 9), side * max(10.0, away + rng.normal(0, 7)))
