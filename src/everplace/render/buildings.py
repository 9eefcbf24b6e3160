"""Blueprints of buildings: each function builds one at a site."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from everplace.render.mesh import Material, Pair, Site, upright

__all__ = ["barn", "box", "church", "house", "silo", "water_tower"]


def box(
    site: Site, centre: Pair, half: Pair, heights: Pair, material: Material, *, rank: int = 0, reach: float = 420.0
) -> None:
    """A box around a centre, of half a length and width; `heights` are its bottom and top above the ground."""
    low, high = heights
    ring = _ring(centre, half)
    inside = (*centre, (low + high) / 2)
    for start, end in pairwise(ring):
        site.face(upright(start, end, low, high), material, inside=inside, rank=rank, reach=reach)
    for level in heights:
        site.face([(*corner, level) for corner in ring[:4]], material, inside=inside, rank=rank, reach=reach)


def _ring(centre: Pair, half: Pair) -> list[Pair]:
    """The corners of a rectangle, the first once more at the end."""
    (ca, cb), (a, b) = centre, half
    return [(ca - a, cb - b), (ca + a, cb - b), (ca + a, cb + b), (ca - a, cb + b), (ca - a, cb - b)]


def _hall(
    site: Site, half: Pair, eaves: float, ridge: float, wall: Material, roof: Material, reach: float = 420.0
) -> None:
    """Four walls and a gabled roof with an overhang; the ridge runs along the object."""
    a, b = half
    box(site, (0, 0), half, (-2.0, eaves), wall, reach=reach)
    inside = (0, 0, eaves / 2)
    for end in (-a, a):
        site.face(((end, -b, eaves), (end, b, eaves), (end, 0, ridge)), wall, inside=inside, reach=reach)
    over, drop = 0.5, 0.5 * (ridge - eaves) / b
    for side in (-1, 1):
        edge, foot = side * (b + over), eaves - drop
        slope = ((-a - over, edge, foot), (a + over, edge, foot), (a + over, 0, ridge), (-a - over, 0, ridge))
        site.face(slope, roof, inside=inside, rank=3, reach=reach)


def _window(site: Site, at: Pair, axis: str, size: Pair, sill: float, material: Material = Material.GLASS) -> None:
    """A pane in a white frame on a wall; `axis` tells whether the wall runs along or across the object."""
    (along, across), (half, tall) = at, size  # half the width, the whole height
    inside = (along * 0.5, across * 0.5, sill)
    for grow, paint, rank, reach in ((0.14, Material.WHITE, 1, 70.0), (0.0, material, 2, 170.0)):
        (da, ga), (db, gb) = ((half, grow), (0, 0)) if axis == "along" else ((0, 0), (half, grow))
        start, end = (along - da - ga, across - db - gb), (along + da + ga, across + db + gb)
        pane = upright(start, end, sill - grow, sill + tall + grow)
        site.face(pane, paint, inside=inside, rank=rank, reach=reach)


def house(site: Site, rng: np.random.Generator) -> None:
    """A dwelling of one or two floors with windows, door and chimney."""
    a, b = rng.uniform(4.5, 7.5), rng.uniform(3.6, 5.0)
    floors = int(rng.integers(1, 3))
    eaves = 0.5 + 2.7 * floors
    ridge = eaves + b * rng.uniform(0.7, 1.15)
    wall = list(Material)[rng.integers(Material.PLASTER_WHITE, Material.BRICK + 1)]
    roof = Material.ROOF_TILE if rng.random() < 0.6 else Material.ROOF_SLATE
    _hall(site, (a, b), eaves, ridge, wall, roof)
    for floor in range(floors):
        sill = 1.2 + 2.7 * floor
        for side in (-1, 1):
            for place in np.linspace(-a + 1.4, a - 1.4, int(a // 1.6)):
                _window(site, (float(place), side * (b + 0.03)), "along", (0.5, 1.2), sill)
            for place in (-b / 2, b / 2):
                _window(site, (side * (a + 0.03), place), "across", (0.5, 1.2), sill)
    for side in (-1, 1):
        _window(site, (side * (a + 0.03), 0), "across", (0.4, 0.9), eaves + 0.4)
    _window(site, (rng.uniform(-a / 2, a / 2), b + 0.06), "along", (0.5, 2.0), 0.15, Material.DOOR)
    chimney = rng.uniform(-a / 2, a / 2)
    box(site, (chimney, 0.6), (0.35, 0.35), (ridge - 1.2, ridge + 0.9), Material.BRICK, rank=4)


def barn(site: Site, rng: np.random.Generator) -> None:
    """A long barn with a gate."""
    a, b = rng.uniform(8, 13), rng.uniform(5, 7)
    eaves, ridge = rng.uniform(3.5, 5), rng.uniform(7.5, 10)
    wall = Material.WOOD_RED if rng.random() < 0.55 else Material.WOOD
    _hall(site, (a, b), eaves, ridge, wall, Material.ROOF_SLATE)
    for side in (-1, 1):
        _window(site, (side * (a + 0.05), 0), "across", (1.9, 3.2), 0.1, Material.DOOR)
        _window(site, (0, side * (b + 0.05)), "along", (1.9, 2.9), 0.1, Material.DOOR)


def church(site: Site) -> None:
    """A nave with a tower and a spire."""
    white, slate = Material.PLASTER_WHITE, Material.ROOF_SLATE
    _hall(site, (9, 4.5), 6, 11, white, slate, 900)
    for place in (-6.0, -2.0, 2.0, 6.0):
        for side in (-1, 1):
            _window(site, (place, side * 4.55), "along", (0.5, 3.0), 2.0)
    box(site, (11.5, 0), (2.6, 2.6), (-2, 17), white, rank=4, reach=900)
    for start, end in pairwise(_ring((11.5, 0), (2.9, 2.9))):
        spire = ((*start, 16.6), (*end, 16.6), (11.5, 0, 28))
        site.face(spire, slate, inside=(11.5, 0, 14), rank=5, reach=900)


def silo(site: Site, rng: np.random.Generator) -> None:
    """A round silo under a flat cone."""
    _drum(site, rng.uniform(1.8, 2.8), (-2.0, rng.uniform(9, 14)), 1.6, Material.METAL)


def water_tower(site: Site) -> None:
    """A tank on a shaft."""
    _drum(site, 1.6, (-2.0, 19.0), 0.0, Material.CONCRETE)
    _drum(site, 5.0, (18.0, 25.0), 2.5, Material.PLASTER_WHITE, rank=2)


def _drum(site: Site, radius: float, heights: Pair, cone: float, material: Material, rank: int = 0) -> None:
    low, high = heights
    inside = (0, 0, (low + high) / 2)
    angles = np.linspace(0, 2 * np.pi, 11)
    ring = zip((radius * np.cos(angles)).tolist(), (radius * np.sin(angles)).tolist(), strict=True)
    for start, end in pairwise(ring):
        site.face(upright(start, end, low, high), material, inside=inside, rank=rank, reach=900)
        roof = ((*start, high), (*end, high), (0, 0, high + cone))
        site.face(roof, material, inside=inside, rank=rank + 1, reach=900)
