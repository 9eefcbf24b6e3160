"""Blueprints of what stands beside a road besides buildings: each function builds one object at a site."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from everplace.render.buildings import box
from everplace.render.mesh import Material, Point, Site, upright

__all__ = ["bridge", "lamp", "pylon", "sign", "turbine"]


def lamp(site: Site) -> None:
    """A street lamp; its arm points along the site's axis."""
    site.stroke((0, 0, -0.5), (0, 0, 6.2), 0.14, Material.METAL, reach=160)
    site.stroke((0, 0, 6.2), (1.6, 0, 6.5), 0.12, Material.METAL, reach=120)
    site.stroke((1.2, 0, 6.4), (2.0, 0, 6.45), 0.22, Material.LAMP, rank=1, reach=320)


def sign(site: Site, board: Material, shape: str) -> None:
    """A road sign whose board stands across the site's axis; shape is `triangle`, `square` or `board`."""
    site.stroke((0, 0, -0.5), (0, 0, 2.6), 0.1, Material.METAL, reach=140)
    if shape == "triangle":
        border = Material.RED
        outer: Sequence[Point] = ((0, -0.6, 1.7), (0, 0.6, 1.7), (0, 0, 2.8))
        inner: Sequence[Point] = ((0, -0.33, 1.87), (0, 0.33, 1.87), (0, 0, 2.5))
    else:
        border = Material.WHITE
        half, low, high = (0.5, 1.7, 2.7) if shape == "square" else (1.6, 1.5, 3.1)
        outer, inner = (upright((0, m - half), (0, half - m), low + m, high - m) for m in (0.0, 0.1))
    site.face(outer, border, rank=1, reach=160)
    site.face(inner, board, rank=2, reach=120)


def pylon(site: Site) -> None:
    """A lattice mast with two arms across the site's axis."""
    for across in (-1, 1):
        for along in (-1, 1):
            site.stroke((2.4 * along, 2.4 * across, -1), (0, 0.3 * across, 27), 0.22, Material.METAL, reach=700)
    for step in range(5):
        wide, narrow, low = 2.4 - 0.42 * step, 2.4 - 0.42 * (step + 1), step * 5.0
        for side in (-1, 1):
            site.stroke((0, -side * wide, low), (0, side * narrow, low + 5), 0.12, Material.METAL, reach=260)
    for level, half in ((20.0, 6.0), (24.0, 4.5)):
        site.stroke((0, -half, level), (0, half, level), 0.3, Material.METAL, reach=700)


def turbine(site: Site, rng: np.random.Generator) -> None:
    """A wind turbine, seen from far; its rotor stands still."""
    hub = 75.0
    site.face(((0, -1.9, -3.0), (0, 1.9, -3.0), (0, 1.1, hub), (0, -1.1, hub)), Material.WHITE, reach=3000)
    turn = rng.uniform(0, 2 * np.pi)
    for blade in range(3):
        angle = turn + blade * 2 * np.pi / 3
        tip = (-2, 42 * float(np.sin(angle)), hub + 42 * float(np.cos(angle)))
        site.stroke((-2, 0, hub), tip, 1.6, Material.WHITE, rank=1, reach=3000)


def bridge(site: Site) -> None:
    """An overpass across the road: the site's axis runs along the deck."""
    for side in (-1, 1):
        box(site, (side * 9.0, 0), (2.0, 3.4), (-2, 5.2), Material.STONE, reach=500)
    box(site, (0, 0), (38.0, 3.6), (5.2, 6.3), Material.CONCRETE, rank=2, reach=500)
    for side in (-1, 1):
        for level in (6.8, 7.3):
            site.stroke((-38, side * 3.5, level), (38, side * 3.5, level), 0.1, Material.METAL, rank=3)
    for near, far in ((-11, -40), (11, 40)):  # the earth ramps
        ramp = ((near, -3.4, 6.2), (near, 3.4, 6.2), (far, 3.4, -6.0), (far, -3.4, -6.0))
        site.face(ramp, Material.STONE, rank=1, reach=500)
