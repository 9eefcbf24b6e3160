"""Blueprints of buildings: each function adds one to a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from everplace.render.mesh import Material, MeshBuilder, Point

__all__ = ["Site", "barn", "block", "church", "house", "silo", "water_tower"]


@dataclass(frozen=True, slots=True)
class Site:
    """Where an object stands.

    Attributes:
        x: World position in metres.
        y: World position in metres.
        z: Height of the ground in metres.
        yaw: Direction of its length axis in radians.
    """

    x: float
    y: float
    z: float
    yaw: float

    def point(self, along: float, across: float, up: float) -> Point:
        """Returns the world point at an offset along and across the object's axis and above its ground."""
        c, s = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return self.x + along * c - across * s, self.y + along * s + across * c, self.z + up

    @property
    def anchor(self) -> tuple[float, float]:
        """Its ground position."""
        return self.x, self.y


def block(
    mesh: MeshBuilder,
    site: Site,
    centre: tuple[float, float],
    half: tuple[float, float],
    heights: tuple[float, float],
    material: Material,
    *,
    rank: int = 0,
    reach: float = 420.0,
) -> None:
    """A box: `centre` and `half` are (along, across) in metres, `heights` its bottom and top above the ground."""
    (ca, cb), (a, b), (low, high) = centre, half, heights
    ring = [(ca - a, cb - b), (ca + a, cb - b), (ca + a, cb + b), (ca - a, cb + b)]
    inside = site.point(ca, cb, (low + high) / 2)
    for (a0, b0), (a1, b1) in zip(ring, ring[1:] + ring[:1], strict=True):
        wall = (
            site.point(a0, b0, low),
            site.point(a1, b1, low),
            site.point(a1, b1, high),
            site.point(a0, b0, high),
        )
        mesh.face(wall, material, site.anchor, inside=inside, rank=rank, reach=reach)
    for level in (low, high):
        cap = tuple(site.point(u, v, level) for u, v in ring)
        mesh.face(cap, material, site.anchor, inside=inside, rank=rank, reach=reach)


def _gable(
    mesh: MeshBuilder,
    site: Site,
    half: tuple[float, float],
    eaves: float,
    ridge: float,
    wall: Material,
    roof: Material,
    reach: float,
) -> None:
    """Gable triangles and a roof with an overhang; the ridge runs along the object."""
    a, b = half
    inside = site.point(0, 0, eaves / 2)
    for end in (-a, a):
        triangle = (site.point(end, -b, eaves), site.point(end, b, eaves), site.point(end, 0, ridge))
        mesh.face(triangle, wall, site.anchor, inside=inside, reach=reach)
    over, drop = 0.5, 0.5 * (ridge - eaves) / b
    for side in (-1, 1):
        slope = (
            site.point(-a - over, side * (b + over), eaves - drop),
            site.point(a + over, side * (b + over), eaves - drop),
            site.point(a + over, 0, ridge),
            site.point(-a - over, 0, ridge),
        )
        mesh.face(slope, roof, site.anchor, inside=inside, rank=3, reach=reach)


def _window(
    mesh: MeshBuilder,
    site: Site,
    at: tuple[float, float],
    axis: str,
    size: tuple[float, float],
    sill: float,
    material: Material = Material.GLASS,
) -> None:
    """A pane on a wall; `axis` tells whether the wall runs along or across the object."""
    (along, across), (half, tall) = at, size
    da, db = (half, 0.0) if axis == "along" else (0.0, half)
    inside = site.point(along * 0.5, across * 0.5, sill)
    for grow, paint, rank in ((0.14, Material.WHITE, 1), (0.0, material, 2)):
        ga, gb = (grow if da else 0.0), (grow if db else 0.0)
        pane = (
            site.point(along - da - ga, across - db - gb, sill - grow),
            site.point(along + da + ga, across + db + gb, sill - grow),
            site.point(along + da + ga, across + db + gb, sill + tall + grow),
            site.point(along - da - ga, across - db - gb, sill + tall + grow),
        )
        reach = 170.0 if rank == 2 else 70.0
        mesh.face(pane, paint, site.anchor, inside=inside, rank=rank, reach=reach)


def house(mesh: MeshBuilder, site: Site, rng: np.random.Generator) -> None:
    """A dwelling of one or two floors with windows, door and chimney."""
    a, b = float(rng.uniform(4.5, 7.5)), float(rng.uniform(3.6, 5.0))
    floors = int(rng.integers(1, 3))
    eaves = 0.5 + 2.7 * floors
    ridge = eaves + b * float(rng.uniform(0.7, 1.15))
    wall = Material(int(rng.integers(Material.PLASTER_WHITE, Material.BRICK + 1)))
    roof = Material.ROOF_TILE if rng.random() < 0.6 else Material.ROOF_SLATE
    block(mesh, site, (0, 0), (a, b), (-2.0, eaves), wall)
    _gable(mesh, site, (a, b), eaves, ridge, wall, roof, 420.0)
    columns = int(a // 1.6)
    for floor in range(floors):
        sill = 1.2 + 2.7 * floor
        for side in (-1, 1):
            for place in np.linspace(-a + 1.4, a - 1.4, columns):
                _window(mesh, site, (float(place), side * (b + 0.03)), "along", (0.5, 1.2), sill)
            for place in (-b / 2, b / 2):
                _window(mesh, site, (side * (a + 0.03), place), "across", (0.5, 1.2), sill)
    for side in (-1, 1):
        _window(mesh, site, (side * (a + 0.03), 0), "across", (0.4, 0.9), eaves + 0.4)
    door = float(rng.uniform(-a / 2, a / 2))
    _window(mesh, site, (door, b + 0.06), "along", (0.5, 2.0), 0.15, Material.DOOR)
    chimney = float(rng.uniform(-a / 2, a / 2))
    block(mesh, site, (chimney, 0.6), (0.35, 0.35), (ridge - 1.2, ridge + 0.9), Material.BRICK, rank=4)


def barn(mesh: MeshBuilder, site: Site, rng: np.random.Generator) -> None:
    """A long barn with a gate."""
    a, b = float(rng.uniform(8, 13)), float(rng.uniform(5, 7))
    eaves, ridge = float(rng.uniform(3.5, 5)), float(rng.uniform(7.5, 10))
    wall = Material.WOOD_RED if rng.random() < 0.55 else Material.WOOD
    block(mesh, site, (0, 0), (a, b), (-2.0, eaves), wall)
    _gable(mesh, site, (a, b), eaves, ridge, wall, Material.ROOF_SLATE, 420.0)
    for side in (-1, 1):
        _window(mesh, site, (side * (a + 0.05), 0), "across", (1.9, 3.2), 0.1, Material.DOOR)
        _window(mesh, site, (0, side * (b + 0.05)), "along", (1.9, 2.9), 0.1, Material.DOOR)


def church(mesh: MeshBuilder, site: Site) -> None:
    """A nave with a tower and a spire."""
    white, slate = Material.PLASTER_WHITE, Material.ROOF_SLATE
    block(mesh, site, (0, 0), (9, 4.5), (-2, 6), white, reach=900)
    _gable(mesh, site, (9, 4.5), 6, 11, white, slate, 900)
    for place in (-6.0, -2.0, 2.0, 6.0):
        for side in (-1, 1):
            _window(mesh, site, (place, side * 4.55), "along", (0.5, 3.0), 2.0)
    block(mesh, site, (11.5, 0), (2.6, 2.6), (-2, 17), white, rank=4, reach=900)
    inside, tip = site.point(11.5, 0, 14), site.point(11.5, 0, 28)
    ring = [(8.6, -2.9), (14.4, -2.9), (14.4, 2.9), (8.6, 2.9)]
    for (a0, b0), (a1, b1) in zip(ring, ring[1:] + ring[:1], strict=True):
        spire = (site.point(a0, b0, 16.6), site.point(a1, b1, 16.6), tip)
        mesh.face(spire, slate, site.anchor, inside=inside, rank=5, reach=900)


def silo(mesh: MeshBuilder, site: Site, rng: np.random.Generator) -> None:
    """A round silo under a flat cone."""
    _drum(mesh, site, float(rng.uniform(1.8, 2.8)), (-2.0, float(rng.uniform(9, 14))), 1.6, Material.METAL)


def water_tower(mesh: MeshBuilder, site: Site) -> None:
    """A tank on a shaft."""
    _drum(mesh, site, 1.6, (-2.0, 19.0), 0.0, Material.CONCRETE)
    _drum(mesh, site, 5.0, (18.0, 25.0), 2.5, Material.PLASTER_WHITE, rank=2)


def _drum(
    mesh: MeshBuilder,
    site: Site,
    radius: float,
    heights: tuple[float, float],
    cone: float,
    material: Material,
    rank: int = 0,
) -> None:
    low, high = heights
    inside = site.point(0, 0, (low + high) / 2)
    angles = np.linspace(0, 2 * np.pi, 11)
    ring = [(radius * float(np.cos(t)), radius * float(np.sin(t))) for t in angles]
    for (a0, b0), (a1, b1) in pairwise(ring):
        foot0, foot1 = site.point(a0, b0, low), site.point(a1, b1, low)
        top0, top1 = site.point(a0, b0, high), site.point(a1, b1, high)
        mesh.face((foot0, foot1, top1, top0), material, site.anchor, inside=inside, rank=rank, reach=900)
        roof = (top0, top1, site.point(0, 0, high + cone))
        mesh.face(roof, material, site.anchor, inside=inside, rank=rank + 1, reach=900)
