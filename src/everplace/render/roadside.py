"""The road's furniture: marker posts, poles with wires, lamps, fences, rails, signs, bridges, pylons, turbines."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from everplace.render import structures
from everplace.render.mesh import Material, Point, Site
from everplace.render.planner import Planner
from everplace.render.road import BEFORE, Biome, Segment

__all__ = ["furnish"]

_SIGNS = (
    (Material.WHITE, "triangle"),
    (Material.BLUE, "square"),
    (Material.YELLOW, "board"),
    (Material.BLUE, "board"),
)


def furnish(planner: Planner) -> None:
    """Adds the furniture of the whole road."""
    rng = planner.rng
    for segment in planner.road.segments:
        if segment.left == Biome.VILLAGE:
            for number, x in enumerate(np.arange(segment.start + 6, segment.end, 26.0)):
                side = 1 if number % 2 else -1
                structures.lamp(planner.site(float(x), side * 6.4, -side * np.pi / 2))
            structures.sign(planner.site(segment.start + 3, -6.3), Material.YELLOW, "board")
        else:
            _marker_posts(planner, segment)
        for side, biome in segment.sides:
            if biome in (Biome.MEADOW, Biome.FARM, Biome.ORCHARD) and rng.random() < 0.75:
                _fence(planner, segment, side * rng.uniform(7.0, 9.0))
            elif biome == Biome.LAKE or (biome != Biome.VILLAGE and rng.random() < 0.12):
                _guard_rail(planner, segment, side * 5.6)
            elif biome == Biome.VILLAGE and rng.random() < 0.7:
                _wall(planner, segment, side * 7.2)
    start, end = -BEFORE, planner.road.segments[-1].end
    _poles(planner, start, end)
    for x in planner.along(start + 30.0, end, 50, 150):
        material, shape = _SIGNS[rng.integers(len(_SIGNS))]
        lateral = -6.8 if shape == "board" else -5.4
        structures.sign(planner.site(x, lateral, rng.uniform(-0.1, 0.1)), material, shape)
    for x in planner.along(start + rng.uniform(300, 800), end, 650, 1300):
        structures.bridge(planner.site(x, 0.0, np.pi / 2 + rng.uniform(-0.25, 0.25)))
    for x in planner.along(start + rng.uniform(100, 500), end, 500, 1000):
        _pylons(planner, x)
    for x in planner.along(start + rng.uniform(200, 700), end, 900, 1800):
        side = int(rng.choice([-1, 1]))
        for number in range(rng.integers(2, 6)):
            away = side * rng.uniform(280, 700)
            structures.turbine(planner.site(x + 130.0 * number, away, rng.uniform(-0.3, 0.3)), rng)


def _row(planner: Planner, segment: Segment, spacing: float, lateral: float) -> list[Site]:
    """Sites along a stretch, `spacing` metres of x apart."""
    return [planner.site(float(x), lateral) for x in np.arange(segment.start, segment.end, spacing)]


def _marker_posts(planner: Planner, segment: Segment) -> None:
    for side in (-1, 1):
        for site in _row(planner, segment, 25.0, side * 4.9):
            site.stroke((0, 0, 0), (0, 0, 1.0), 0.13, Material.WHITE, reach=110)
            site.stroke((0, 0, 0.68), (0, 0, 0.85), 0.14, Material.RED, rank=1, reach=70)


def _fence(planner: Planner, segment: Segment, lateral: float) -> None:
    planks = planner.rng.random() < 0.4
    material = Material.WHITE if planks and planner.rng.random() < 0.5 else Material.WOOD
    rails, thickness, reach = ((0.5, 0.85, 1.2), 0.12, 90) if planks else ((0.55, 1.05), 0.05, 60)
    sites = _row(planner, segment, 4.0, lateral)
    for site in sites:
        site.stroke((0, 0, -0.3), (0, 0, 1.3), 0.14, material, rank=1, reach=110)
    for before, site in pairwise(sites):
        for level in rails:
            ends = before.point(0, 0, level), site.point(0, 0, level)
            site.mesh.add(ends, material, site.anchor, thickness=thickness, reach=reach)


def _guard_rail(planner: Planner, segment: Segment, lateral: float) -> None:
    sites = _row(planner, segment, 4.0, lateral)
    for site in sites:
        site.stroke((0, 0, -0.3), (0, 0, 0.7), 0.12, Material.METAL, reach=90)
    for before, site in pairwise(sites):
        _panel(before, site, 0.45, 0.78, Material.METAL, rank=1)


def _wall(planner: Planner, segment: Segment, lateral: float) -> None:
    x = np.arange(segment.start, segment.end, 6.0)
    for position, (before, site) in zip(x[1:], pairwise(_row(planner, segment, 6.0, lateral)), strict=True):
        if int(position / 6) % 4:  # every fourth piece is a gap
            _panel(before, site, -0.6, 1.0, Material.STONE, rank=0)


def _panel(before: Site, site: Site, low: float, high: float, material: Material, rank: int) -> None:
    """An upright face from one site to the next."""
    corners = before.point(0, 0, low), site.point(0, 0, low), site.point(0, 0, high), before.point(0, 0, high)
    site.mesh.add(corners, material, site.anchor, rank=rank, reach=200)


def _poles(planner: Planner, start: float, end: float) -> None:
    """Telegraph poles with two wires that sag, along one side for a while, then the other or none."""
    rng, x = planner.rng, start
    while x < end:
        lateral = float(rng.choice([-1, 1])) * rng.uniform(8.0, 10.5)
        stop = min(x + rng.uniform(220, 520), end)
        sites = []
        while x < stop:
            sites.append(planner.site(x, lateral))
            x += 38.0
        for site in sites:
            site.stroke((0, 0, -1), (0, 0, 8.2), 0.26, Material.WOOD, reach=320)
            site.stroke((0, -0.9, 7.6), (0, 0.9, 7.6), 0.14, Material.WOOD, rank=1, reach=160)
        for before, site in pairwise(sites):
            for across in (-0.8, 0.8):
                _wire(planner, before.point(0, across, 7.7), site.point(0, across, 7.7), 0.9, 8, 130.0)
        x += rng.uniform(60, 300)


def _wire(planner: Planner, start: Point, end: Point, sag: float, pieces: int, reach: float) -> None:
    t = np.linspace(0, 1, pieces + 1)[:, None]
    a, b = np.array(start), np.array(end)
    points = a + (b - a) * t - 4 * sag * t * (1 - t) * (0, 0, 1)
    for p, q in pairwise(points.tolist()):
        middle = ((p[0] + q[0]) / 2, (p[1] + q[1]) / 2)
        planner.mesh.add((p, q), Material.WIRE, middle, thickness=0.035, reach=reach)


def _pylons(planner: Planner, x: float) -> None:
    """A line of pylons that crosses the road at x."""
    turn = planner.rng.uniform(-0.3, 0.3)
    steps = (130.0 * step for step in (-2.6, -1.4, -0.35, 0.65, 1.6, 2.7))
    sites = [planner.site(x + lateral * turn, lateral, np.pi / 2 - turn) for lateral in steps]
    for site in sites:
        structures.pylon(site)
    for before, site in pairwise(sites):
        for across, level in ((-6.0, 20.0), (6.0, 20.0), (-4.5, 24.0), (4.5, 24.0)):
            _wire(planner, before.point(0, across, level), site.point(0, across, level), 4.0, 10, 420.0)
