"""Seeded smooth noise: endless two-dimensional tiles and one-dimensional profiles."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["TILE", "profile", "ramp", "sample", "tile"]

TILE = 512
"""Side of a noise tile in texels."""


def tile(rng: np.random.Generator, coarsest: int, octaves: int) -> NDArray[np.float32]:
    """Makes a tile of fractal value noise that repeats without a seam.

    Args:
        rng: Source of the lattice values.
        coarsest: Lattice cells along the side in the first octave; each further octave doubles them.
        octaves: Number of octaves, each with half the amplitude of the one before.

    Returns:
        Values in [-1, 1], `TILE` + 1 on each side: the last row and column repeat the first.
    """
    total = np.zeros((TILE, TILE), np.float32)
    for octave in range(octaves):
        cells = coarsest << octave
        lattice = rng.uniform(-1, 1, (cells, cells)).astype(np.float32)
        padded = np.pad(lattice, 2, mode="wrap")
        scale = TILE // cells
        large = cv2.resize(padded, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        total += large[2 * scale : 2 * scale + TILE, 2 * scale : 2 * scale + TILE] * np.float32(0.5**octave)
    total /= np.float32(np.abs(total).max())
    return np.pad(total, (0, 1), mode="wrap")


def sample(
    texture: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32], texel: float
) -> NDArray[np.float32]:
    """Reads a tile at world positions, bilinearly, repeated without end.

    Args:
        texture: A tile from `tile`.
        x: World x in metres, two-dimensional.
        y: World y in metres, same shape.
        texel: Metres per texel.
    """
    # Positions are wrapped here: remap's own BORDER_WRAP takes five times as long.
    maps = []
    for values in (x, y):
        turns = values * np.float32(1 / (texel * TILE))
        turns -= np.floor(turns)
        turns *= np.float32(TILE)
        maps.append(turns)
    return np.asarray(cv2.remap(texture, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def profile(rng: np.random.Generator, length: int, correlation: float) -> NDArray[np.float64]:
    """Makes smooth random values along a line: mean 0, standard deviation 1.

    Args:
        rng: Source of the values.
        length: Number of values.
        correlation: Standard deviation of the Gaussian that smooths white noise, in samples.
    """
    reach = max(1, int(3 * correlation))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / correlation) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    return np.convolve(rng.standard_normal(length + 2 * reach), kernel, mode="valid")


def ramp(values: NDArray[np.floating[Any]], low: float, high: float) -> NDArray[np.float32]:
    """Rises smoothly from 0 at `low` to 1 at `high` (cubic), and stays there."""
    t = np.clip((values - np.float32(low)) / np.float32(high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), np.float32)
