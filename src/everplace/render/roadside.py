"""The road's furniture: marker posts, poles with wires, lamps, fences, rails, signs, bridges, pylons, turbines."""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np

from everplace.render import structures
from everplace.render.buildings import Site
from everplace.render.mesh import Material, MeshBuilder, Point
from everplace.render.road import Biome, Road, Segment

__all__ = ["furnish"]


class _Survey(Protocol):
    def __call__(self, x: float, lateral: float, turn: float = 0.0) -> Site: ...


def furnish(rng: np.random.Generator, mesh: MeshBuilder, survey: _Survey, road: Road, start: float, end: float) -> None:
    """Adds the road's furniture.

    Args:
        rng: Source of all choices.
        mesh: Where the objects go.
        survey: Gives the site at x and a lateral distance, its axis along the road plus a turn.
        road: The road.
        start: x of the beginning in metres.
        end: x of the end in metres.
    """
    for segment in road.segments:
        village = segment.left == Biome.VILLAGE
        if village:
            _lamps(mesh, survey, segment)
            structures.sign(mesh, survey(segment.start + 3, -6.3, 0.0), Material.YELLOW, "board")
        else:
            _marker_posts(mesh, survey, segment)
        for side, biome in ((1, segment.left), (-1, segment.right)):
            if biome in (Biome.MEADOW, Biome.FARM, Biome.ORCHARD) and rng.random() < 0.75:
                _fence(rng, mesh, survey, segment, side * float(rng.uniform(7.0, 9.0)))
            elif biome == Biome.LAKE or (biome != Biome.VILLAGE and rng.random() < 0.12):
                _guard_rail(mesh, survey, segment, side * 5.6)
            elif biome == Biome.VILLAGE and rng.random() < 0.7:
                _wall(mesh, survey, segment, side * 7.2)
    _poles(rng, mesh, survey, start, end)
    _signs(rng, mesh, survey, start, end)
    x = start + float(rng.uniform(300, 800))
    while x < end:
        structures.bridge(mesh, survey(x, 0.0, np.pi / 2 + float(rng.uniform(-0.25, 0.25))))
        x += float(rng.uniform(650, 1300))
    x = start + float(rng.uniform(100, 500))
    while x < end:
        _pylon_line(rng, mesh, survey, x)
        x += float(rng.uniform(500, 1000))
    x = start + float(rng.uniform(200, 700))
    while x < end:
        row_side = float(rng.choice([-1, 1]))
        for number in range(int(rng.integers(2, 6))):
            away = row_side * float(rng.uniform(280, 700))
            structures.turbine(mesh, survey(x + 130.0 * number, away, float(rng.uniform(-0.3, 0.3))), rng)
        x += float(rng.uniform(900, 1800))


def _lamps(mesh: MeshBuilder, survey: _Survey, segment: Segment) -> None:
    for number, x in enumerate(np.arange(segment.start + 6, segment.end, 26.0)):
        side = 1 if number % 2 else -1
        structures.lamp(mesh, survey(float(x), side * 6.4, -side * np.pi / 2))


def _marker_posts(mesh: MeshBuilder, survey: _Survey, segment: Segment) -> None:
    for x in np.arange(segment.start, segment.end, 25.0):
        for side in (-1, 1):
            site = survey(float(x), side * 4.9)
            mesh.stroke(site.point(0, 0, 0), site.point(0, 0, 1.0), 0.13, Material.WHITE, site.anchor, reach=110)
            low, high = site.point(0, 0, 0.68), site.point(0, 0, 0.85)
            mesh.stroke(low, high, 0.14, Material.RED, site.anchor, rank=1, reach=70)


def _fence(rng: np.random.Generator, mesh: MeshBuilder, survey: _Survey, segment: Segment, lateral: float) -> None:
    planks = rng.random() < 0.4
    material = Material.WHITE if planks and rng.random() < 0.5 else Material.WOOD
    rails, thickness = ((0.5, 0.85, 1.2), 0.12) if planks else ((0.55, 1.05), 0.05)
    before: Site | None = None
    for x in np.arange(segment.start, segment.end, 4.0):
        site = survey(float(x), lateral)
        mesh.stroke(site.point(0, 0, -0.3), site.point(0, 0, 1.3), 0.14, material, site.anchor, rank=1, reach=110)
        if before is not None:
            for level in rails:
                start, stop = before.point(0, 0, level), site.point(0, 0, level)
                mesh.stroke(start, stop, thickness, material, site.anchor, reach=90 if planks else 60)
        before = site


def _guard_rail(mesh: MeshBuilder, survey: _Survey, segment: Segment, lateral: float) -> None:
    before: Site | None = None
    for x in np.arange(segment.start, segment.end, 4.0):
        site = survey(float(x), lateral)
        mesh.stroke(site.point(0, 0, -0.3), site.point(0, 0, 0.7), 0.12, Material.METAL, site.anchor, reach=90)
        if before is not None:
            rail = (
                before.point(0, 0, 0.45),
                site.point(0, 0, 0.45),
                site.point(0, 0, 0.78),
                before.point(0, 0, 0.78),
            )
            mesh.face(rail, Material.METAL, site.anchor, rank=1, reach=200)
        before = site


def _wall(mesh: MeshBuilder, survey: _Survey, segment: Segment, lateral: float) -> None:
    before: Site | None = None
    for x in np.arange(segment.start, segment.end, 6.0):
        site = survey(float(x), lateral)
        if before is not None and int(x / 6) % 4:
            corners: tuple[Point, ...] = (
                before.point(0, 0, -0.6),
                site.point(0, 0, -0.6),
                site.point(0, 0, 1.0),
                before.point(0, 0, 1.0),
            )
            mesh.face(corners, Material.STONE, site.anchor, reach=200)
        before = site


def _poles(rng: np.random.Generator, mesh: MeshBuilder, survey: _Survey, start: float, end: float) -> None:
    """Telegraph poles with two wires that sag, along one side for a while, then the other or none."""
    x = start
    while x < end:
        side = float(rng.choice([-1, 1]))
        lateral = side * float(rng.uniform(8.0, 10.5))
        stop = x + float(rng.uniform(220, 520))
        before: Site | None = None
        while x < min(stop, end):
            site = survey(x, lateral)
            mesh.stroke(site.point(0, 0, -1), site.point(0, 0, 8.2), 0.26, Material.WOOD, site.anchor, reach=320)
            arm = (site.point(0, -0.9, 7.6), site.point(0, 0.9, 7.6))
            mesh.stroke(*arm, 0.14, Material.WOOD, site.anchor, rank=1, reach=160)
            if before is not None:
                for across in (-0.8, 0.8):
                    _wire(mesh, before.point(0, across, 7.7), site.point(0, across, 7.7), 0.9)
            before = site
            x += 38.0
        x += float(rng.uniform(60, 300))


def _wire(mesh: MeshBuilder, start: Point, end: Point, sag: float, pieces: int = 8, reach: float = 130.0) -> None:
    a, b = np.array(start), np.array(end)
    points = []
    for t in np.linspace(0, 1, pieces + 1):
        point = a + (b - a) * t
        points.append((float(point[0]), float(point[1]), float(point[2] - 4 * sag * t * (1 - t))))
    for p, q in pairwise(points):
        middle = ((p[0] + q[0]) / 2, (p[1] + q[1]) / 2)
        mesh.stroke(p, q, 0.035, Material.WIRE, middle, reach=reach)


def _pylon_line(rng: np.random.Generator, mesh: MeshBuilder, survey: _Survey, x: float) -> None:
    turn = float(rng.uniform(-0.3, 0.3))
    sites = []
    for step in (-2.6, -1.4, -0.35, 0.65, 1.6, 2.7):
        lateral = step * 130.0
        sites.append(survey(x + lateral * turn, lateral, np.pi / 2 - turn))
    for site in sites:
        structures.pylon(mesh, site)
    for site, following in pairwise(sites):
        for across, level in ((-6.0, 20.0), (6.0, 20.0), (-4.5, 24.0), (4.5, 24.0)):
            _wire(mesh, site.point(0, across, level), following.point(0, across, level), 4.0, 10, 420.0)


def _signs(rng: np.random.Generator, mesh: MeshBuilder, survey: _Survey, start: float, end: float) -> None:
    x = start + 30.0
    while x < end:
        kind = int(rng.integers(4))
        material = (Material.WHITE, Material.BLUE, Material.YELLOW, Material.BLUE)[kind]
        shape = ("triangle", "square", "board", "board")[kind]
        lateral = -6.8 if shape == "board" else -5.4
        structures.sign(mesh, survey(x, lateral, float(rng.uniform(-0.1, 0.1))), material, shape)
        x += float(rng.uniform(50, 150))
