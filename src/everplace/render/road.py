"""The road and what lies along it: bends, climbs, and the stretches of forest, field, village and lake at its sides.

The world's x axis runs along the valley, y to the left of it, in metres. The road is a function of x, so the nearest
point of the road to any place, and with it every field of the terrain, is a table lookup.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from everplace.render.noise import profile

__all__ = ["BEFORE", "WOODS", "Biome", "Column", "Road", "Segment", "make_road"]

_STEP = 2.0  # metres of x between two rows of the road's table
BEFORE = 400.0
"""Metres of road before the first place, which is at x = 0; there the road's table begins."""
_BEYOND = 6500.0  # metres of road after the last place, as far as the camera sees


class Biome(IntEnum):
    """What a stretch of land beside the road is."""

    MEADOW = 0
    CROPS = 1
    CONIFERS = 2
    WOODLAND = 3
    VILLAGE = 4
    FARM = 5
    LAKE = 6
    ORCHARD = 7


WOODS = (Biome.CONIFERS, Biome.WOODLAND)
"""The stretches of forest."""


class Column(IntEnum):
    """Columns of the road's table; where the sides of the road differ, right follows left."""

    CENTRE = 0
    COSINE = 1
    HEIGHT = 2
    ARC = 3
    BANK_LEFT = 4
    BANK_RIGHT = 5
    LAKE_LEFT = 6
    LAKE_RIGHT = 7
    LEVEL = 8
    WOOD_LEFT = 9
    WOOD_RIGHT = 10
    VILLAGE = 11


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of road with one biome on each side; `start` and `end` are positions x in metres."""

    start: float
    end: float
    left: Biome
    right: Biome

    @property
    def sides(self) -> tuple[tuple[int, Biome], tuple[int, Biome]]:
        """1 (left) and -1 (right), each with the biome on that side."""
        return (1, self.left), (-1, self.right)


@dataclass(frozen=True, slots=True)
class Road:
    """The road as a table over x.

    Attributes:
        table: N × 12, a row each 2 m of x from -`BEFORE` on, see `Column`; metres, except the cosine of the heading and
            the strengths in [0, 1] of lake, wood and village.
        biomes: N × 2, the `Biome` left and right.
        segments: The stretches, in order of x.
    """

    table: NDArray[np.float32]
    biomes: NDArray[np.uint8]
    segments: tuple[Segment, ...]

    def rows(self, x: NDArray[np.float32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Returns the table row before each x and the fraction of the way to the next."""
        position = np.clip((x + np.float32(BEFORE)) / np.float32(_STEP), 0, len(self.table) - 1.001)
        row = position.astype(np.int32)
        return row, (position - row).astype(np.float32)

    def lookup(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the table interpolated at each x: the shape of `x` followed by 12 columns."""
        row, fraction = self.rows(x)
        before = self.table[row]
        return np.asarray(before + (self.table[row + 1] - before) * fraction[..., None], np.float32)

    def at(self, x: float, column: Column) -> float:
        """Returns one column at one x."""
        position = min(max((x + BEFORE) / _STEP, 0.0), len(self.table) - 1.001)
        row = int(position)
        before, after = float(self.table[row, column]), float(self.table[row + 1, column])
        return before + (after - before) * (position - row)

    def x_of_arc(self, arc: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns x where the road has come `arc` metres from x = 0."""
        x = _STEP * np.arange(len(self.table)) - BEFORE
        return np.asarray(np.interp(arc, self.table[:, Column.ARC].astype(np.float64), x), np.float64)

    def heading(self, x: float) -> float:
        """Returns the road's heading at x in radians, counter-clockwise from the x axis."""
        rise = self.at(x + 1, Column.CENTRE) - self.at(x - 1, Column.CENTRE)
        return float(np.arctan2(rise, 2.0))


def make_road(rng: np.random.Generator, length: float) -> Road:
    """Lays out the road and the stretches along it.

    Args:
        rng: Source of all choices.
        length: Metres of x that hold places.
    """
    count = int((BEFORE + length + _BEYOND) / _STEP) + 2
    heading = 0.62 * np.tanh(0.9 * profile(rng, count, 45 / _STEP) + 0.5 * profile(rng, count, 160 / _STEP))
    table = np.zeros((count, len(Column)), np.float64)
    for column, gradient in ((Column.CENTRE, np.tan(heading)), (Column.ARC, 1 / np.cos(heading))):
        integral = np.concatenate([[0.0], np.cumsum((gradient[:-1] + gradient[1:]) / 2) * _STEP])
        table[:, column] = integral - integral[int(BEFORE / _STEP)]
    table[:, Column.COSINE] = np.cos(heading)
    table[:, Column.HEIGHT] = 7.0 * profile(rng, count, 190 / _STEP) + 0.9 * profile(rng, count, 45 / _STEP)
    for column in (Column.BANK_LEFT, Column.BANK_RIGHT):
        table[:, column] = 0.035 + 0.10 * profile(rng, count, 55 / _STEP)

    segments = _segments(rng, length)
    biomes = np.zeros((count, 2), np.uint8)
    for segment in segments:
        first, last = (int((x + BEFORE) / _STEP) for x in (segment.start, segment.end))
        biomes[first:last] = (segment.left, segment.right)
        table[first:last, Column.LEVEL] = table[first : last + 1, Column.HEIGHT].min() - 1.3
    for side in (0, 1):
        table[:, Column.LAKE_LEFT + side] = _soften(biomes[:, side] == Biome.LAKE)
        table[:, Column.WOOD_LEFT + side] = _soften(np.isin(biomes[:, side], WOODS))
    table[:, Column.VILLAGE] = _soften((biomes == Biome.VILLAGE).any(axis=1))
    return Road(table.astype(np.float32), biomes, segments)


def _soften(flags: NDArray[np.bool_]) -> NDArray[np.float64]:
    kernel = np.hanning(17)
    return np.convolve(flags.astype(np.float64), kernel / kernel.sum(), mode="same")


def _segments(rng: np.random.Generator, length: float) -> tuple[Segment, ...]:
    """Draws the stretches; a village is on both sides, and no stretch is like the one before."""
    chances = np.array([0.15, 0.2, 0.15, 0.16, 0.0, 0.11, 0.11, 0.12])
    segments: list[Segment] = []
    position, village_in = -BEFORE, rng.uniform(300, 600)
    previous = (Biome.MEADOW, Biome.MEADOW)
    while position < length + 800:
        end = position + rng.uniform(85.0, 190.0)
        if village_in <= 0:
            left = right = Biome.VILLAGE
            village_in = rng.uniform(500, 900)
        else:
            left, right = (_other_than(rng, chances, biome) for biome in previous)
            if rng.random() < 0.35 and left != Biome.LAKE:
                right = left
        village_in -= end - position
        segments.append(Segment(position, end, left, right))
        position, previous = end, (left, right)
    return tuple(segments)


def _other_than(rng: np.random.Generator, chances: NDArray[np.float64], biome: Biome) -> Biome:
    weights = chances.copy()
    weights[biome] = 0
    return Biome(rng.choice(len(weights), p=weights / weights.sum()))
