"""Blueprints of what people built: each function adds one object to a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from everplace.data.render.mesh import Material, MeshBuilder, Point

__all__ = [
    "Site",
    "barn",
    "bridge",
    "church",
    "house",
    "lamp",
    "pylon",
    "sign",
    "silo",
    "turbine",
    "water_tower",
]


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


def _block(
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
    """A box with its top: `centre` and `half` are (along, across), `heights` bottom and top."""
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
    _block(mesh, site, (0, 0), (a, b), (-2.0, eaves), wall)
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
    _block(mesh, site, (chimney, 0.6), (0.35, 0.35), (ridge - 1.2, ridge + 0.9), Material.BRICK, rank=4)


def barn(mesh: MeshBuilder, site: Site, rng: np.random.Generator) -> None:
    """A long barn with a gate."""
    a, b = float(rng.uniform(8, 13)), float(rng.uniform(5, 7))
    eaves, ridge = float(rng.uniform(3.5, 5)), float(rng.uniform(7.5, 10))
    wall = Material.WOOD_RED if rng.random() < 0.55 else Material.WOOD
    _block(mesh, site, (0, 0), (a, b), (-2.0, eaves), wall)
    _gable(mesh, site, (a, b), eaves, ridge, wall, Material.ROOF_SLATE, 420.0)
    for side in (-1, 1):
        _window(mesh, site, (side * (a + 0.05), 0), "across", (1.9, 3.2), 0.1, Material.DOOR)
        _window(mesh, site, (0, side * (b + 0.05)), "along", (1.9, 2.9), 0.1, Material.DOOR)


def church(mesh: MeshBuilder, site: Site) -> None:
    """A nave with a tower and a spire."""
    white, slate = Material.PLASTER_WHITE, Material.ROOF_SLATE
    _block(mesh, site, (0, 0), (9, 4.5), (-2, 6), white, reach=900)
    _gable(mesh, site, (9, 4.5), 6, 11, white, slate, 900)
    for place in (-6.0, -2.0, 2.0, 6.0):
        for side in (-1, 1):
            _window(mesh, site, (place, side * 4.55), "along", (0.5, 3.0), 2.0)
    _block(mesh, site, (11.5, 0), (2.6, 2.6), (-2, 17), white, rank=4, reach=900)
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
    for (a0, b0), (a1, b1) in zip(ring, ring[1:], strict=False):
        foot0, foot1 = site.point(a0, b0, low), site.point(a1, b1, low)
        top0, top1 = site.point(a0, b0, high), site.point(a1, b1, high)
        mesh.face((foot0, foot1, top1, top0), material, site.anchor, inside=inside, rank=rank, reach=900)
        roof = (top0, top1, site.point(0, 0, high + cone))
        mesh.face(roof, material, site.anchor, inside=inside, rank=rank + 1, reach=900)


def lamp(mesh: MeshBuilder, site: Site) -> None:
    """A street lamp; its arm points along the site's axis."""
    top = site.point(0, 0, 6.2)
    mesh.stroke(site.point(0, 0, -0.5), top, 0.14, Material.METAL, site.anchor, reach=160)
    mesh.stroke(top, site.point(1.6, 0, 6.5), 0.12, Material.METAL, site.anchor, reach=120)
    mesh.stroke(
        site.point(1.2, 0, 6.4), site.point(2.0, 0, 6.45), 0.22, Material.LAMP, site.anchor, rank=1, reach=320
    )


def sign(mesh: MeshBuilder, site: Site, board: Material, shape: str) -> None:
    """A road sign whose board stands across the site's axis; shape is `triangle`, `square` or `board`."""
    mesh.stroke(site.point(0, 0, -0.5), site.point(0, 0, 2.6), 0.1, Material.METAL, site.anchor, reach=140)
    half, low, high = {"triangle": (0.6, 1.7, 2.8), "square": (0.5, 1.7, 2.7), "board": (1.6, 1.5, 3.1)}[
        shape
    ]
    if shape == "triangle":
        corners: tuple[Point, ...] = (
            site.point(0, -half, low),
            site.point(0, half, low),
            site.point(0, 0, high),
        )
        inner: tuple[Point, ...] = (
            site.point(0, -0.33, 1.87),
            site.point(0, 0.33, 1.87),
            site.point(0, 0, 2.5),
        )
    else:
        corners, inner = (
            tuple(
                site.point(0, u * (half - m), v)
                for u, v in ((-1, low + m), (1, low + m), (1, high - m), (-1, high - m))
            )
            for m in (0.0, 0.1)
        )
    border = Material.RED if shape == "triangle" else Material.WHITE
    mesh.face(corners, border, site.anchor, rank=1, reach=160)
    mesh.face(inner, board, site.anchor, rank=2, reach=120)


def pylon(mesh: MeshBuilder, site: Site) -> None:
    """A lattice mast with two arms across the site's axis."""
    for across in (-1, 1):
        for along in (-1, 1):
            foot, top = site.point(2.4 * along, 2.4 * across, -1), site.point(0, 0.3 * across, 27)
            mesh.stroke(foot, top, 0.22, Material.METAL, site.anchor, reach=700)
    for step in range(5):
        wide, narrow, low = 2.4 - 0.42 * step, 2.4 - 0.42 * (step + 1), step * 5.0
        for side in (-1, 1):
            start, end = site.point(0, -side * wide, low), site.point(0, side * narrow, low + 5)
            mesh.stroke(start, end, 0.12, Material.METAL, site.anchor, reach=260)
    for level, half in ((20.0, 6.0), (24.0, 4.5)):
        start, end = site.point(0, -half, level), site.point(0, half, level)
        mesh.stroke(start, end, 0.3, Material.METAL, site.anchor, reach=700)


def turbine(mesh: MeshBuilder, site: Site, rng: np.random.Generator) -> None:
    """A wind turbine, seen from far; its rotor stands still."""
    hub = 75.0
    tower = tuple(site.point(0, b, h) for b, h in ((-1.9, -3.0), (1.9, -3.0), (1.1, hub), (-1.1, hub)))
    mesh.face(tower, Material.WHITE, site.anchor, reach=3000)
    turn = float(rng.uniform(0, 2 * np.pi))
    for blade in range(3):
        angle = turn + blade * 2 * np.pi / 3
        tip = site.point(-2, 42 * float(np.sin(angle)), hub + 42 * float(np.cos(angle)))
        mesh.stroke(site.point(-2, 0, hub), tip, 1.6, Material.WHITE, site.anchor, rank=1, reach=3000)


def bridge(mesh: MeshBuilder, site: Site) -> None:
    """An overpass across the road: the site's axis runs along the deck."""
    reach = 500.0
    for side in (-1, 1):
        _block(mesh, site, (side * 9.0, 0), (2.0, 3.4), (-2, 5.2), Material.STONE, reach=reach)
    _block(mesh, site, (0, 0), (38.0, 3.6), (5.2, 6.3), Material.CONCRETE, rank=2, reach=reach)
    for side in (-1, 1):
        for level in (6.8, 7.3):
            start, end = site.point(-38, side * 3.5, level), site.point(38, side * 3.5, level)
            mesh.stroke(start, end, 0.1, Material.METAL, site.anchor, rank=3, reach=200)
    for end in (-1, 1):
        corners = tuple(
            site.point(end * u, v, h)
            for u, v, h in ((11, -3.4, 6.2), (11, 3.4, 6.2), (40, 3.4, -6.0), (40, -3.4, -6.0))
        )
        mesh.face(corners, Material.STONE, site.anchor, rank=1, reach=reach)
