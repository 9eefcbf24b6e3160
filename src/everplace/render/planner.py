"""What the plan of a world is drawn with: sites for buildings, and plants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.render.mesh import MeshBuilder, Site
from everplace.render.road import Column, Road, Segment
from everplace.render.sprites import VARIANTS, Plant
from everplace.render.terrain import Terrain

__all__ = ["Planner", "Plants"]


class Plants(NamedTuple):
    """Trees and bushes that stand alone, ordered by x.

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

    def part(self, chosen: slice | NDArray[np.bool_]) -> Plants:
        """Returns the chosen plants."""
        return Plants._make(values[chosen] for values in self)

    def between(self, low: float, high: float) -> Plants:
        """Returns the plants from x = `low` to x = `high`."""
        return self.part(slice(*np.searchsorted(self.places[:, 0], (low, high))))


# height from, to (metres); width as a share of the height from, to
_SIZES = {
    Plant.CONIFER: (9, 19, 0.48, 0.62),
    Plant.BROADLEAF: (8, 15, 0.75, 0.95),
    Plant.BIRCH: (8, 14, 0.65, 0.8),
    Plant.POPLAR: (13, 20, 0.62, 0.72),
    Plant.FRUIT: (4, 6, 0.85, 1.0),
    Plant.BUSH: (1.2, 2.8, 0.9, 1.3),
}


@dataclass(frozen=True, slots=True)
class Planner:
    """Puts things at positions along and beside the road.

    Attributes:
        rng: Source of all choices.
        road: The road and its stretches.
        terrain: The land to stand on.
        mesh: Collects what is built.
    """

    rng: np.random.Generator
    road: Road
    terrain: Terrain
    mesh: MeshBuilder = field(default_factory=MeshBuilder)
    _plants: list[tuple[float, ...]] = field(default_factory=list)

    def site(self, x: float, lateral: float, turn: float = 0.0) -> Site:
        """Returns the site at x, `lateral` metres to the left of the road, its axis along the road plus a turn."""
        px, py = self._beside(x, lateral)
        z = float(self.terrain.height_at(np.array([px]), np.array([py]))[0])
        return Site(self.mesh, px, py, z, self.road.heading(x) + turn)

    def plant(self, kind: Plant, x: float, lateral: float, scale: float = 1.0) -> None:
        """Plants one tree or bush; its height above the sea follows when all are known."""
        low, high, narrow, wide = _SIZES[kind]
        height = self.rng.uniform(low, high) * scale
        width = height * self.rng.uniform(narrow, wide)
        variant = int(self.rng.integers(VARIANTS))
        self._plants.append((*self._beside(x, lateral), kind, variant, height, width, self.rng.uniform()))

    def _beside(self, x: float, lateral: float) -> tuple[float, float]:
        heading = self.road.heading(x)
        return x - lateral * float(np.sin(heading)), self.road.at(x, Column.CENTRE) + lateral * float(np.cos(heading))

    def scatter(self, segment: Segment, per_metre: float, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Draws positions (x, distance from the road) in a band beside a stretch."""
        for _ in range(self.rng.poisson(per_metre * (segment.end - segment.start))):
            yield self.rng.uniform(segment.start, segment.end), self.rng.uniform(low, high)

    def along(self, start: float, end: float, low: float, high: float) -> Iterator[float]:
        """Draws positions x from `start` to `end`, each `low` to `high` metres after the one before."""
        while start < end:
            yield start
            start += self.rng.uniform(low, high)

    def plants(self) -> Plants:
        """Returns all plants with their heights, without those that would stand in water."""
        rows = np.array(sorted(self._plants), np.float64).reshape(-1, 7)
        surface = self.terrain.surface(*np.hsplit(rows[:, :2].astype(np.float32), 2))
        z = (surface.height - surface.canopy).astype(np.float64)
        plants = Plants(
            kinds=rows[:, 2].astype(np.uint8),
            variants=rows[:, 3].astype(np.uint8),
            places=np.hstack([rows[:, :2], z]),
            sizes=rows[:, 4:6],
            chance=rows[:, 6],
        )
        return plants.part(~surface.water[:, 0])
