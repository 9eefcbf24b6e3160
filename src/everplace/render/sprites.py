"""Pictures of trees and bushes, grown once per drive and pasted wherever such a plant stands.

A plant's shape (trunk, branches, where its leaves hang) comes from its kind and variant alone; the look decides
the colours, whether leaves hang there at all, and on what lies snow.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.look import Colour, Look

__all__ = ["DECIDUOUS", "LEVELS", "SPRITE_SIZE", "VARIANTS", "Nursery", "Plant", "Sprite"]

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


DECIDUOUS = frozenset({Plant.BROADLEAF, Plant.BIRCH, Plant.POPLAR, Plant.FRUIT, Plant.BUSH})
"""Plants whose crowns are open to the view in winter."""

_CROWNS = {
    # centre (share of the height from the ground), half height, half width (shares of height and of width), blobs
    Plant.BROADLEAF: (0.62, 0.35, 0.46, 900),
    Plant.BIRCH: (0.60, 0.37, 0.32, 620),
    Plant.POPLAR: (0.54, 0.45, 0.19, 700),
    Plant.FRUIT: (0.60, 0.34, 0.46, 640),
    Plant.BUSH: (0.44, 0.42, 0.47, 700),
}


@dataclass(frozen=True, slots=True)
class Sprite:
    """A picture with its reductions.

    Attributes:
        levels: RGBA images, colours premultiplied by alpha; each level has half the sides of the one before.
    """

    levels: tuple[NDArray[np.uint8], ...]


class Nursery:
    """The plants of one look, each grown when it is first asked for."""

    def __init__(self, look: Look) -> None:
        self._look = look
        self._grown: dict[tuple[Plant, int, bool], Sprite] = {}

    def picture(self, plant: Plant, variant: int, from_left: bool) -> Sprite:
        """Returns a plant's picture; threads may ask at the same time and get equal ones.

        Args:
            plant: The kind.
            variant: The shape, below `VARIANTS`.
            from_left: Whether the light comes from the left.
        """
        key = (plant, variant, from_left)
        if key not in self._grown:
            rng = np.random.default_rng([plant, variant])
            self._grown[key] = _picture(plant, variant, self._look, from_left, rng)
        return self._grown[key]

    def grow_all(self) -> None:
        """Grows every plant now, so that copies of the nursery need not."""
        for plant in Plant:
            for variant in range(VARIANTS):
                for from_left in (False, True):
                    self.picture(plant, variant, from_left)


def _picture(plant: Plant, variant: int, look: Look, from_left: bool, rng: np.random.Generator) -> Sprite:
    rgb = np.zeros((_HEIGHT, _WIDTH, 3), np.uint8)
    alpha = np.zeros((_HEIGHT, _WIDTH), np.uint8)
    if plant == Plant.CONIFER:
        _conifer(rgb, alpha, look, from_left, rng)
    else:
        _broadleaf(plant, variant, rgb, alpha, look, from_left, rng)
    share = alpha[..., None].astype(np.float32) / 255
    full = np.dstack([(rgb * share).astype(np.uint8), alpha])
    levels = [full]
    while len(levels) < LEVELS:
        last = levels[-1]
        size = (last.shape[1] // 2, last.shape[0] // 2)
        levels.append(np.asarray(cv2.resize(last, size, interpolation=cv2.INTER_AREA), np.uint8))
    return Sprite(tuple(levels))


def _lit(colour: Colour, amount: float, look: Look) -> Colour:
    """Mixes shade and sun light on a colour; `amount` 0 is full shade, 1 full light."""
    strength = amount * (0.35 + 0.65 * look.sun)
    mixed = [
        c * (shade + (sun - shade) * strength)
        for c, shade, sun in zip(colour, look.shade_colour, look.sun_colour, strict=True)
    ]
    return mixed[0], mixed[1], mixed[2]


def _blob(
    rgb: NDArray[np.uint8], alpha: NDArray[np.uint8], at: tuple[float, float], size: float, colour: Colour
) -> None:
    centre = (int(at[0] * 16), int(at[1] * 16))
    radius = max(8, int(size * 16))
    cv2.circle(rgb, centre, radius, colour, -1, cv2.LINE_AA, 4)
    cv2.circle(alpha, centre, radius, 255, -1, cv2.LINE_AA, 4)


def _stroke(
    rgb: NDArray[np.uint8],
    alpha: NDArray[np.uint8] | None,
    start: tuple[float, float],
    end: tuple[float, float],
    thickness: float,
    colour: Colour,
) -> None:
    """Draws a line; without `alpha` it colours only what is there (snow does not change a shape)."""
    first, last = ((int(p[0] * 16), int(p[1] * 16)) for p in (start, end))
    width = max(1, round(thickness))
    cv2.line(rgb, first, last, colour, width, cv2.LINE_AA, 4)
    if alpha is not None:
        cv2.line(alpha, first, last, 255.0, width, cv2.LINE_AA, 4)


def _conifer(
    rgb: NDArray[np.uint8], alpha: NDArray[np.uint8], look: Look, from_left: bool, rng: np.random.Generator
) -> None:
    middle, spread = _WIDTH / 2, rng.uniform(0.30, 0.42) * _WIDTH
    _stroke(rgb, alpha, (middle, _GROUND), (middle, 20), 5, _lit((84, 64, 50), 0.4, look))
    tiers = int(rng.integers(11, 15))
    for tier in range(tiers):
        share = (tier + 1) / tiers  # the lowest tier is drawn first, the top last
        base = _GROUND - 18 - (1 - (1 - share)) * (_HEIGHT - 34)
        reach = spread * (1 - share) ** 0.85 + 4
        for _ in range(26):
            side = float(rng.uniform(-1, 1))
            droop = abs(side) * reach * 0.42
            tip = (middle + side * reach, base + droop + float(rng.uniform(-5, 7)))
            root = (middle + side * reach * 0.25, base - 9)
            light = 0.5 - 0.5 * side if from_left else 0.5 + 0.5 * side
            tint = float(rng.uniform(0.8, 1.2))
            green = (look.needles[0] * tint, look.needles[1] * tint, look.needles[2] * tint)
            _stroke(rgb, alpha, root, tip, 5, _lit(green, light * 0.9, look))
            snowy = float(rng.uniform())
            if snowy < 0.5 * look.snow:
                top = (root[0] * 0.4 + tip[0] * 0.6, root[1] * 0.4 + tip[1] * 0.6 - 2)
                _stroke(rgb, None, top, (tip[0], tip[1] - 2), 4, _lit((236, 240, 247), 0.4 + 0.6 * light, look))


def _branches(plant: Plant, rng: np.random.Generator) -> list[tuple[tuple[float, float], tuple[float, float], float]]:
    """Grows the skeleton: strokes from the trunk outwards, as (start, end, thickness) in pixels."""
    centre, half_height, half_width, _ = _CROWNS[plant]
    strokes: list[tuple[tuple[float, float], tuple[float, float], float]] = []
    middle = _WIDTH / 2

    def grow(start: tuple[float, float], angle: float, length: float, thickness: float) -> None:
        end = (start[0] + length * np.sin(angle), start[1] - length * np.cos(angle))
        strokes.append((start, end, thickness))
        if thickness < 1.1 or length < 5:
            return
        for _ in range(3 if thickness < 4 else 2):
            turn = float(rng.uniform(-0.75, 0.75)) * (0.45 if plant == Plant.POPLAR else 1)
            grow(end, angle * 0.85 + turn, length * float(rng.uniform(0.6, 0.85)), thickness * 0.66)

    top, low = _HEIGHT * (1 - centre - half_height), _HEIGHT * (1 - centre + half_height)
    if plant == Plant.POPLAR:
        strokes.append(((middle, float(_GROUND)), (middle, top + 14), 6.0))
        for row in np.linspace(low, top + 20, 22):
            for side in (-1, 1):
                grow(
                    (middle, float(row)),
                    side * float(rng.uniform(0.25, 0.5)),
                    float(rng.uniform(14, 22)),
                    1.5,
                )
        return strokes
    stems = 4 if plant == Plant.BUSH else 1
    for stem in range(stems):
        lean = (stem - (stems - 1) / 2) * 0.45
        base = (middle + lean * 14, float(_GROUND))
        neck = (middle + lean * 40, low - 0.15 * (low - top))
        strokes.append((base, neck, 8.0 if stems == 1 else 3.0))
        for angle in np.linspace(-0.9, 0.9, 6) * (half_width / 0.46):
            thickness = 4.4 if stems == 1 else 2.0
            grow(neck, float(angle + rng.uniform(-0.15, 0.15) + lean), (neck[1] - top) * 0.29, thickness)
    return strokes


def _broadleaf(
    plant: Plant,
    variant: int,
    rgb: NDArray[np.uint8],
    alpha: NDArray[np.uint8],
    look: Look,
    from_left: bool,
    rng: np.random.Generator,
) -> None:
    bark: Colour = (222, 218, 210) if plant == Plant.BIRCH else (86, 70, 58)
    for start, end, thickness in _branches(plant, rng):
        trunk = bark if thickness > 4 or plant != Plant.BIRCH else (96, 80, 74)
        _stroke(rgb, alpha, start, end, thickness, _lit(trunk, 0.55, look))
        if look.snow and thickness < 5 and abs(end[0] - start[0]) > abs(end[1] - start[1]) * 0.6:
            _stroke(
                rgb,
                None,
                (start[0], start[1] - 1),
                (end[0], end[1] - 1),
                1,
                _lit((228, 232, 240), 0.7, look),
            )
    if look.leaves == "bare":
        return
    centre, half_height, half_width, blobs = _CROWNS[plant]
    density = {"young": 0.6, "full": 1.0, "turning": 0.6}[look.leaves]
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
    order = np.lexsort((places[:, 1], lobes[member, 1]))
    blossom = look.leaves == "young" and plant == Plant.FRUIT
    for index in order:
        if keep[index] > density:
            continue
        u, v = float(places[index, 0]), float(places[index, 1])
        at = (_WIDTH * (0.5 + u * half_width), _HEIGHT * (1 - centre - v * half_height))
        side = -u if from_left else u
        light = float(np.clip(0.45 + 0.28 * side + 0.36 * rise[index] + 0.13 * mottle[index], 0, 1))
        tint = 1 + 0.14 * float(tints[index])
        white = blossom and blossoms[index] < 0.75
        base: Colour = (246, 226, 230) if white else (colour[0] * tint, colour[1] * tint, colour[2] * tint)
        _blob(rgb, alpha, at, 1.6 + 3.4 * float(radius[index]), _lit(base, light, look))
