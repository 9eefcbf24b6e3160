"""Blueprints of what stands beside a road besides buildings: each function adds one object to a mesh."""

from __future__ import annotations

import numpy as np

from everplace.render.buildings import Site, block
from everplace.render.mesh import Material, MeshBuilder, Point

__all__ = ["bridge", "lamp", "pylon", "sign", "turbine"]


def lamp(mesh: MeshBuilder, site: Site) -> None:
    """A street lamp; its arm points along the site's axis."""
    top = site.point(0, 0, 6.2)
    mesh.stroke(site.point(0, 0, -0.5), top, 0.14, Material.METAL, site.anchor, reach=160)
    mesh.stroke(top, site.point(1.6, 0, 6.5), 0.12, Material.METAL, site.anchor, reach=120)
    mesh.stroke(site.point(1.2, 0, 6.4), site.point(2.0, 0, 6.45), 0.22, Material.LAMP, site.anchor, rank=1, reach=320)


def sign(mesh: MeshBuilder, site: Site, board: Material, shape: str) -> None:
    """A road sign whose board stands across the site's axis; shape is `triangle`, `square` or `board`."""
    mesh.stroke(site.point(0, 0, -0.5), site.point(0, 0, 2.6), 0.1, Material.METAL, site.anchor, reach=140)
    half, low, high = {"triangle": (0.6, 1.7, 2.8), "square": (0.5, 1.7, 2.7), "board": (1.6, 1.5, 3.1)}[shape]
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
        block(mesh, site, (side * 9.0, 0), (2.0, 3.4), (-2, 5.2), Material.STONE, reach=reach)
    block(mesh, site, (0, 0), (38.0, 3.6), (5.2, 6.3), Material.CONCRETE, rank=2, reach=reach)
    for side in (-1, 1):
        for level in (6.8, 7.3):
            start, end = site.point(-38, side * 3.5, level), site.point(38, side * 3.5, level)
            mesh.stroke(start, end, 0.1, Material.METAL, site.anchor, rank=3, reach=200)
    for side in (-1, 1):  # the earth ramps
        corners = tuple(
            site.point(side * u, v, h)
            for u, v, h in ((11, -3.4, 6.2), (11, 3.4, 6.2), (40, 3.4, -6.0), (40, -3.4, -6.0))
        )
        mesh.face(corners, Material.STONE, site.anchor, rank=1, reach=reach)
