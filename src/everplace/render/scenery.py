"""Where everything stands: plants, buildings, poles, fences and signs along the stretches of the road."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from everplace.render import buildings
from everplace.render.buildings import Site
from everplace.render.mesh import Mesh, MeshBuilder
from everplace.render.road import BEFORE, Biome, Column, Road, Segment
from everplace.render.roadside import furnish
from everplace.render.sprites import VARIANTS, Plant
from everplace.render.terrain import Terrain

__all__ = ["Plants", "Scenery", "plan_scenery"]


@dataclass(frozen=True, slots=True)
class Plants:
    """All trees and bushes that stand alone, ordered by x.

    Attributes:
        kinds: N, see `Plant`.
        variants: N, shape of the kind.
        places: N × 3, foot of the plant in metres.
        sizes: N × 2, height and width in metres.
        chance: N, a fixed random number in [0, 1) each, by which distant plants are thinned out.
    """

    kinds: NDArray[np.uint8]
    variants: NDArray[np.uint8]
    places: NDArray[np.float64]
    sizes: NDArray[np.float64]
    chance: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scenery:
    """What stands on the land.

    Attributes:
        plants: Trees and bushes.
        mesh: Everything built.
    """

    plants: Plants
    mesh: Mesh


# height from, to (metres); width as a share of the height from, to
_SIZES = {
    Plant.CONIFER: (9, 19, 0.48, 0.62),
    Plant.BROADLEAF: (8, 15, 0.75, 0.95),
    Plant.BIRCH: (8, 14, 0.65, 0.8),
    Plant.POPLAR: (13, 20, 0.62, 0.72),
    Plant.FRUIT: (4, 6, 0.85, 1.0),
    Plant.BUSH: (1.2, 2.8, 0.9, 1.3),
}


@dataclass(slots=True)
class _Planner:
    """Puts things at positions along and beside the road."""

    rng: np.random.Generator
    road: Road
    terrain: Terrain
    mesh: MeshBuilder
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def spot(self, x: float, lateral: float) -> tuple[float, float]:
        """World position beside the road at x, `lateral` metres to the left."""
        heading = self.road.heading(x)
        return x - lateral * float(np.sin(heading)), self.road.at(x, Column.CENTRE) + lateral * float(np.cos(heading))

    def site(self, x: float, lateral: float, turn: float = 0.0) -> Site:
        """A building site, its axis along the road plus a turn."""
        px, py = self.spot(x, lateral)
        z = float(self.terrain.height_at(np.array([px]), np.array([py]))[0])
        return Site(px, py, z, self.road.heading(x) + turn)

    def plant(self, kind: Plant, x: float, lateral: float, scale: float = 1.0) -> None:
        """One plant; its height above the sea follows when all are known."""
        low, high, narrow, wide = _SIZES[kind]
        height = float(self.rng.uniform(low, high)) * scale
        width = height * float(self.rng.uniform(narrow, wide))
        px, py = self.spot(x, lateral)
        variant = int(self.rng.integers(VARIANTS))
        self.rows.append((px, py, float(kind), variant, height, width, float(self.rng.uniform())))

    def scatter(self, segment: Segment, per_metre: float, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Random positions (x, distance from the road) in a band beside a stretch."""
        for _ in range(int(self.rng.poisson(per_metre * (segment.end - segment.start)))):
            yield float(self.rng.uniform(segment.start, segment.end)), float(self.rng.uniform(low, high))

    def grown(self) -> Plants:
        """All plants with their heights, without those that would stand in water."""
        rows = np.array(sorted(self.rows), np.float64).reshape(-1, 7)
        x, y = rows[:, 0].astype(np.float32)[:, None], rows[:, 1].astype(np.float32)[:, None]
        surface = self.terrain.surface(x, y)
        dry = surface.water[:, 0] < 0.5
        z = (surface.height - surface.canopy)[:, 0].astype(np.float64)
        places = np.column_stack([rows[:, :2], z])[dry]
        rows = rows[dry]
        return Plants(rows[:, 2].astype(np.uint8), rows[:, 3].astype(np.uint8), places, rows[:, 4:6], rows[:, 6])


def plan_scenery(rng: np.random.Generator, road: Road, terrain: Terrain) -> Scenery:
    """Plans everything that stands along the road.

    Args:
        rng: Source of all choices.
        road: The road and its stretches.
        terrain: The land to stand on.
    """
    planner = _Planner(rng, road, terrain, MeshBuilder(rng))
    for segment in road.segments:
        for side, biome in ((1, segment.left), (-1, segment.right)):
            _plan_side(planner, segment, side, biome)
    last = road.segments[-1].end
    furnish(rng, planner.mesh, planner.site, road, -BEFORE, last)
    return Scenery(planner.grown(), planner.mesh.build())


def _plan_side(planner: _Planner, segment: Segment, side: int, biome: Biome) -> None:
    if biome in (Biome.CONIFERS, Biome.WOODLAND):
        _forest(planner, segment, side, biome)
    elif biome == Biome.VILLAGE:
        _village(planner, segment, side)
    elif biome == Biome.FARM:
        _farm(planner, segment, side)
    elif biome == Biome.ORCHARD:
        for x in np.arange(segment.start, segment.end, 7.5):
            for away in np.arange(11, 48, 7.5):
                planner.plant(Plant.FRUIT, float(x + planner.rng.uniform(-0.5, 0.5)), side * float(away))
    elif biome == Biome.LAKE:
        for x, away in planner.scatter(segment, 0.22, 8.5, 13):
            planner.plant(Plant.BUSH, x, side * away, 0.7)
        for x, away in planner.scatter(segment, 0.03, 9, 14):
            planner.plant(Plant.BIRCH, x, side * away)
    else:
        _open_land(planner, segment, side, biome)


def _forest(planner: _Planner, segment: Segment, side: int, biome: Biome) -> None:
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


def _village(planner: _Planner, segment: Segment, side: int) -> None:
    rng = planner.rng
    x = segment.start + float(rng.uniform(4, 14))
    church = float(rng.uniform(segment.start + 30, segment.end - 10)) if side > 0 else -1e9
    while x < segment.end - 8:
        if abs(x - church) < 16:
            buildings.church(planner.mesh, planner.site(x, side * 27.0, float(rng.choice([0, np.pi]))))
            church = -1e9
            x += 22
        turn = float(rng.choice([0.0, np.pi / 2, np.pi])) + float(rng.uniform(-0.08, 0.08))
        buildings.house(planner.mesh, planner.site(x, side * float(rng.uniform(13, 17)), turn), rng)
        if rng.random() < 0.6:
            turn = float(rng.uniform(0, 2 * np.pi))
            buildings.house(planner.mesh, planner.site(x + 6, side * float(rng.uniform(34, 52)), turn), rng)
        x += float(rng.uniform(17, 27))
    for x, away in planner.scatter(segment, 0.10, 8, 45):
        planner.plant(Plant.FRUIT if rng.random() < 0.5 else Plant.BROADLEAF, x, side * away, 0.8)
    for x, away in planner.scatter(segment, 0.12, 7.0, 9.5):
        planner.plant(Plant.BUSH, x, side * away, 0.7)


def _farm(planner: _Planner, segment: Segment, side: int) -> None:
    rng = planner.rng
    x = float(rng.uniform(segment.start + 20, segment.end - 20))
    buildings.barn(planner.mesh, planner.site(x, side * float(rng.uniform(24, 34)), float(rng.uniform(-0.6, 0.6))), rng)
    buildings.house(planner.mesh, planner.site(x + 26, side * 22.0, float(rng.uniform(-0.2, 0.2))), rng)
    for step in range(int(rng.integers(0, 3))):
        buildings.silo(planner.mesh, planner.site(x - 18 - 6 * step, side * 30.0), rng)
    if rng.random() < 0.3:
        buildings.water_tower(planner.mesh, planner.site(x - 40, side * 70.0))
    for px, away in planner.scatter(segment, 0.06, 12, 60):
        planner.plant(Plant.BROADLEAF if rng.random() < 0.6 else Plant.FRUIT, px, side * away)


def _open_land(planner: _Planner, segment: Segment, side: int, biome: Biome) -> None:
    rng = planner.rng
    kinds = [Plant.BROADLEAF, Plant.POPLAR, Plant.BIRCH, Plant.CONIFER]
    for x, away in planner.scatter(segment, 0.035 if biome == Biome.MEADOW else 0.015, 10, 110):
        planner.plant(kinds[int(rng.integers(4))], x, side * away)
    for x, away in planner.scatter(segment, 0.06, 8, 60):
        planner.plant(Plant.BUSH, x, side * away)
    choice = rng.random()
    if choice < 0.28:  # an avenue
        kind = Plant.POPLAR if rng.random() < 0.5 else Plant.BROADLEAF
        spacing = float(rng.uniform(10, 18))
        for x in np.arange(segment.start, segment.end, spacing):
            planner.plant(kind, float(x), side * 7.8, 0.85)
    elif choice < 0.55:  # hedges that lead away from the road
        for _ in range(int(rng.integers(1, 4))):
            x = float(rng.uniform(segment.start, segment.end))
            for away in np.arange(11, 75, 2.2):
                planner.plant(Plant.BUSH, x + float(rng.uniform(-0.6, 0.6)), side * float(away))
    elif choice < 0.7:  # a copse
        x, away = float(rng.uniform(segment.start, segment.end)), float(rng.uniform(30, 60))
        for _ in range(22):
            kind = Plant.CONIFER if rng.random() < 0.4 else Plant.BROADLEAF
            planner.plant(kind, x + float(rng.normal(0, 9)), side * max(10.0, away + float(rng.normal(0, 7))))
