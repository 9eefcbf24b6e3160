"""Pictures of trees and bushes, grown once per drive and pasted wherever such a plant stands.

A plant's shape (trunk, branches, where its leaves hang) comes from its kind and variant alone; the look decides
the colours, whether leaves hang there at all, and on what lies snow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.look import Look

__all__ = ["LEVELS", "SPRITE_SIZE", "VARIANTS", "Nursery", "Plant"]

VARIANTS = 4
"""Different shapes of each plant."""
LEVELS = 5
"""Pictures of each plant, each with half the sides of the one before."""
SPRITE_SIZE = (224, 160)
"""Height and width of the largest."""
_HEIGHT, _WIDTH = SPRITE_SIZE
_GROUND = _HEIGHT - 2


class Plant(IntEnum):
    """Kinds of plants."""

    CONIFER = 0
    BROADLEAF = 1
    BIRCH = 2
    POPLAR = 3
    FRUIT = 4
    BUSH = 5


_CROWNS = {
    # centre (share of the height from the ground), half height, half width (shares of height and of width), blobs
    Plant.BROADLEAF: (0.62, 0.35, 0.46, 900),
    Plant.BIRCH: (0.60, 0.37, 0.32, 620),
    Plant.POPLAR: (0.54, 0.45, 0.19, 700),
    Plant.FRUIT: (0.60, 0.34, 0.46, 640),
    Plant.BUSH: (0.44, 0.42, 0.47, 700),
}


_Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Nursery:
    """The plants of one look, each grown when it is first asked for.

    Attributes:
        look: The look.
    """

    look: Look
    _grown: dict[tuple[Plant, int, bool], tuple[NDArray[np.uint8], ...]] = field(default_factory=dict)

    def picture(self, plant: Plant, variant: int, from_left: bool) -> tuple[NDArray[np.uint8], ...]:
        """Returns a plant's picture in `LEVELS` sizes; threads may ask at the same time and get equal ones.

        Args:
            plant: The kind.
            variant: The shape, below `VARIANTS`.
            from_left: Whether the light comes from the left.

        Returns:
            RGBA, colours premultiplied by alpha; each with half the sides of the one before.
        """
        key = (plant, variant, from_left)
        if key not in self._grown:
            drawing = _Drawing(self.look, -1 if from_left else 1)
            rng = np.random.default_rng([plant, variant])
            if plant == Plant.CONIFER:
                _conifer(drawing, rng)
            else:
                _broadleaf(drawing, plant, variant, rng)
            self._grown[key] = drawing.pyramid()
        return self._grown[key]

    def grow_all(self) -> None:
        """Grows every plant now, so that copies of the nursery need not."""
        for plant, variant, from_left in product(Plant, range(VARIANTS), (False, True)):
            self.picture(plant, variant, from_left)


@dataclass(frozen=True, slots=True)
class _Drawing:
    """A plant while it is drawn.

    Attributes:
        look: Gives the light.
        sunward: Direction of the light: -1 from the left, 1 from the right.
        rgb: H × W × 3.
        alpha: H × W.
    """

    look: Look
    sunward: int
    rgb: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((_HEIGHT, _WIDTH, 3), np.uint8))
    alpha: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((_HEIGHT, _WIDTH), np.uint8))

    def _lit(self, colour: Sequence[float], light: float) -> list[float]:
        """Mixes the light of shade (`light` 0) and sun (1) on a colour."""
        strength = light * (0.35 + 0.65 * self.look.sun)
        shades = zip(colour, self.look.shade_colour, self.look.sun_colour, strict=True)
        return [c * (shade + (sun - shade) * strength) for c, shade, sun in shades]

    def stroke(
        self, start: _Point, end: _Point, thickness: float, colour: Sequence[float], light: float, *, snow: bool = False
    ) -> None:
        """Draws a line; snow colours only what is there: it does not change a shape."""
        first, last = _fixed_point(start), _fixed_point(end)
        width = max(1, round(thickness))
        cv2.line(self.rgb, first, last, self._lit(colour, light), width, cv2.LINE_AA, 4)
        if not snow:
            cv2.line(self.alpha, first, last, 255.0, width, cv2.LINE_AA, 4)

    def blob(self, at: _Point, size: float, colour: Sequence[float], light: float) -> None:
        """Draws a clump of leaves or needles."""
        centre, radius = _fixed_point(at), max(8, int(size * 16))
        cv2.circle(self.rgb, centre, radius, self._lit(colour, light), -1, cv2.LINE_AA, 4)
        cv2.circle(self.alpha, centre, radius, 255, -1, cv2.LINE_AA, 4)

    def pyramid(self) -> tuple[NDArray[np.uint8], ...]:
        """Returns the picture in all sizes, premultiplied."""
        share = self.alpha[..., None].astype(np.float32) / 255
        levels = [np.dstack([(self.rgb * share).astype(np.uint8), self.alpha])]
        for _ in range(1, LEVELS):
            height, width = levels[-1].shape[:2]
            half = cv2.resize(levels[-1], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
            levels.append(np.asarray(half, np.uint8))
        return tuple(levels)


def _fixed_point(point: _Point) -> tuple[int, int]:
    """A position in 1/16 pixel."""
    return int(point[0] * 16), int(point[1] * 16)


def _conifer(drawing: _Drawing, rng: np.random.Generator) -> None:
    look, middle, spread = drawing.look, _WIDTH / 2, rng.uniform(0.30, 0.42) * _WIDTH
    drawing.stroke((middle, _GROUND), (middle, 20), 5, (84, 64, 50), 0.4)
    tiers = int(rng.integers(11, 15))
    for tier in range(1, tiers + 1):
        share = tier / tiers  # the lowest tier is drawn first, the top last
        base = _GROUND - 18 - share * (_HEIGHT - 34)
        reach = spread * (1 - share) ** 0.85 + 4
        for _ in range(26):
            side = rng.uniform(-1, 1)
            droop = abs(side) * reach * 0.42
            tip = (middle + side * reach, base + droop + rng.uniform(-5, 7))
            root = (middle + side * reach * 0.25, base - 9)
            light = 0.5 + 0.5 * drawing.sunward * side
            tint = rng.uniform(0.8, 1.2)
            drawing.stroke(root, tip, 5, [c * tint for c in look.needles], light * 0.9)
            if rng.uniform() < 0.5 * look.snow:
                top = (root[0] * 0.4 + tip[0] * 0.6, root[1] * 0.4 + tip[1] * 0.6 - 2)
                drawing.stroke(top, (tip[0], tip[1] - 2), 4, (236, 240, 247), 0.4 + 0.6 * light, snow=True)


def _branches(plant: Plant, rng: np.random.Generator) -> list[tuple[_Point, _Point, float]]:
    """Grows the skeleton: strokes from the trunk outwards, as (start, end, thickness) in pixels."""
    centre, half_height, half_width, _ = _CROWNS[plant]
    strokes: list[tuple[_Point, _Point, float]] = []
    middle = _WIDTH / 2

    def grow(start: _Point, angle: float, length: float, thickness: float) -> None:
        end = (start[0] + length * np.sin(angle), start[1] - length * np.cos(angle))
        strokes.append((start, end, thickness))
        if thickness < 1.1 or length < 5:
            return
        for _ in range(3 if thickness < 4 else 2):
            turn = rng.uniform(-0.75, 0.75) * (0.45 if plant == Plant.POPLAR else 1)
            grow(end, angle * 0.85 + turn, length * rng.uniform(0.6, 0.85), thickness * 0.66)

    top, low = _HEIGHT * (1 - centre - half_height), _HEIGHT * (1 - centre + half_height)
    if plant == Plant.POPLAR:
        strokes.append(((middle, _GROUND), (middle, top + 14), 6.0))
        for row in np.linspace(low, top + 20, 22):
            for side in (-1, 1):
                grow((middle, row), side * rng.uniform(0.25, 0.5), rng.uniform(14, 22), 1.5)
        return strokes
    stems, trunk, bough = (4, 3.0, 2.0) if plant == Plant.BUSH else (1, 8.0, 4.4)
    for stem in range(stems):
        lean = (stem - (stems - 1) / 2) * 0.45
        neck = (middle + lean * 40, low - 0.15 * (low - top))
        strokes.append(((middle + lean * 14, _GROUND), neck, trunk))
        for angle in np.linspace(-0.9, 0.9, 6) * (half_width / 0.46):
            grow(neck, angle + rng.uniform(-0.15, 0.15) + lean, (neck[1] - top) * 0.29, bough)
    return strokes


def _broadleaf(drawing: _Drawing, plant: Plant, variant: int, rng: np.random.Generator) -> None:
    look = drawing.look
    trunk, twigs = ((222, 218, 210), (96, 80, 74)) if plant == Plant.BIRCH else ((86, 70, 58), (86, 70, 58))
    for start, end, thickness in _branches(plant, rng):
        drawing.stroke(start, end, thickness, trunk if thickness > 4 else twigs, 0.55)
        if look.snow and thickness < 5 and abs(end[0] - start[0]) > abs(end[1] - start[1]) * 0.6:
            above = (start[0], start[1] - 1), (end[0], end[1] - 1)
            drawing.stroke(*above, 1, (228, 232, 240), 0.7, snow=True)
    if look.leaves == "bare":
        return
    centre, half_height, half_width, blobs = _CROWNS[plant]
    density = 1.0 if look.leaves == "full" else 0.6
    colour = look.reeds if plant == Plant.BUSH else look.foliage[variant]
    lobes = rng.uniform(-0.72, 0.72, (11, 2))
    # All choices are drawn before any depends on the look: the shape stays the same under every condition.
    keep, radius, blossoms = rng.uniform(size=(3, blobs))
    mottle, tints = rng.normal(size=(2, blobs))
    member = rng.integers(0, len(lobes), blobs)
    places = lobes[member] + rng.normal(0, 0.2, (blobs, 2))
    places /= np.maximum(1, np.linalg.norm(places, axis=1, keepdims=True))
    # Lobe by lobe from the bottom up, each with its own dark foot and lit top, as boughs lie over one another.
    rise = places[:, 1] + 0.9 * (places[:, 1] - lobes[member, 1])
    light = np.clip(0.45 + 0.28 * drawing.sunward * places[:, 0] + 0.36 * rise + 0.13 * mottle, 0, 1)
    white = (blossoms < 0.75) & (look.leaves == "young") & (plant == Plant.FRUIT)
    for index in np.lexsort((places[:, 1], lobes[member, 1])):
        if keep[index] > density:
            continue
        u, v = places[index]
        at = (_WIDTH * (0.5 + u * half_width), _HEIGHT * (1 - centre - v * half_height))
        leaf = (246, 226, 230) if white[index] else [c * (1 + 0.14 * tints[index]) for c in colour]
        drawing.blob(at, 1.6 + 3.4 * radius[index], leaf, light[index])
