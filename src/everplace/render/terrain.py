"""The land: height, water and tree canopy anywhere in the world, and what of it a camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.camera import Camera
from everplace.render.noise import ramp, sample
from everplace.render.road import Column, Road

__all__ = ["FAR", "Land", "Surface", "Terrain", "view_terrain"]

FAR = 6000.0
"""Depth in metres behind which there is only sky."""
# Depths of the samples: dense where the edges of forests and hills are seen, sparse on the road before the wheels.
_STEPS = np.concatenate(
    [
        np.geomspace(1.2, 20, 26, endpoint=False),
        np.geomspace(20, 400, 96, endpoint=False),
        np.geomspace(400, FAR, 30),
    ]
).astype(np.float32)
_SAMPLES = len(_STEPS)
_CROWN = 13.0


class Surface(NamedTuple):
    """The surface at world positions; all arrays have the shape of the positions.

    Attributes:
        height: Height of what is seen, tree tops included, in metres.
        lateral: Signed distance from the middle of the road, left positive, in metres.
        canopy: Height of the closed forest's crowns above the ground, in metres; 0 outside forest.
        water: Whether it is a lake.
    """

    height: NDArray[np.float32]
    lateral: NDArray[np.float32]
    canopy: NDArray[np.float32]
    water: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Terrain:
    """Height field around the road.

    Attributes:
        road: The road, which the land near it follows.
        hills: Noise tile of long waves.
        detail: Noise tile of short waves.
    """

    road: Road
    hills: NDArray[np.float32]
    detail: NDArray[np.float32]

    def surface(self, x: NDArray[np.float32], y: NDArray[np.float32]) -> Surface:
        """Computes the surface at world positions (two-dimensional arrays, metres)."""
        row = self.road.lookup(x)
        lateral = (y - row[..., Column.CENTRE]) * row[..., Column.COSINE]
        left, away = lateral > 0, np.abs(lateral)
        bank, lake, wood = (
            np.where(left, row[..., column], row[..., column + 1])
            for column in (Column.BANK_LEFT, Column.LAKE_LEFT, Column.WOOD_LEFT)
        )
        swell = 6.5 * sample(self.hills, x, y, 3.0) + bank * np.minimum(away, 90)
        height = row[..., Column.HEIGHT] + ramp(away, 5, 42) * swell
        height += ramp(away, 130, 1300) * 120 * (1 - 1.6 * np.abs(sample(self.hills, x, y, 13.0)))
        height += ramp(away, 700, 3600) * 900 * (0.75 - np.abs(sample(self.hills, x, y, 41.0))) ** 2
        height -= 0.4 * np.exp(-(((away - 6.4) / 0.9) ** 2))

        shore = 5 * sample(self.detail, x, y, 1.5)
        bowl = lake * ramp(away + shore, 10, 22) * (1 - ramp(away + 4 * shore, 120, 220))
        level = row[..., Column.LEVEL]
        height += bowl * (level - 2 - height)
        water = (height < level) & (bowl > 0.3)
        height = np.where(water, level, height)

        # Closed forest behind the roadside trees of the woods, and copses on the hills.
        edge = away + 5 * sample(self.detail, x, y, 1.1)
        beside = np.where(wood > 0.5, ramp(edge, 24, 27), 0) * (away < 260)
        copses = ramp(sample(self.hills, y, x, 2.2) + 0.1 * sample(self.detail, x, y, 0.9), 0.16, 0.2)
        crowns = 1 + 0.32 * sample(self.detail, x, y, 0.7)
        forest = (_CROWN * crowns * np.maximum(beside, copses * ramp(away, 110, 125))).astype(np.float32)
        canopy = forest * (1 - np.minimum(bowl * 3, 1))
        return Surface((height + canopy).astype(np.float32), lateral, canopy.astype(np.float32), water)

    def height_at(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the height of the ground under trees at world positions of any shape."""
        surface = self.surface(x.astype(np.float32).reshape(-1, 1), y.astype(np.float32).reshape(-1, 1))
        return (surface.height - surface.canopy).astype(np.float64).reshape(x.shape)


class Land(NamedTuple):
    """The visible land, for the image rows from `top` down; all arrays are rows × W.

    Attributes:
        top: First image row that shows any land.
        seen: Whether the pixel shows land.
        depth: Distance along the optical axis in metres; `FAR` where there is sky.
        x: World x of the point seen, in metres.
        y: World y of the point seen, in metres.
        lateral: Signed distance from the road in metres.
        canopy: Crown height above ground in metres.
        crown: How high in the forest the point lies: 0 at its foot, 1 at the height of its crowns.
        water: Whether it is a lake.
        slope_x: Rise of the surface along x.
        slope_y: Rise of the surface along y.
    """

    top: int
    seen: NDArray[np.bool_]
    depth: NDArray[np.float32]
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    lateral: NDArray[np.float32]
    canopy: NDArray[np.float32]
    crown: NDArray[np.float32]
    water: NDArray[np.bool_]
    slope_x: NDArray[np.float32]
    slope_y: NDArray[np.float32]


def view_terrain(terrain: Terrain, camera: Camera) -> Land:
    """Finds for each pixel the first point of the terrain along its ray.

    Each image column is a vertical plane. Along it the terrain is sampled at depths that grow; the
    running maximum of the slope from the camera is sorted, so one binary search per pixel finds the sample that
    hides it.
    """
    width, coarse = camera.width, -(-camera.width // 2)
    sideways = camera.column_slopes()
    # Every other column is sampled; those between are interpolated.
    fan = np.asarray(cv2.resize(sideways[None], (coarse, 1), interpolation=cv2.INTER_AREA), np.float32)[0]
    surface = terrain.surface(*camera.ground_points(_STEPS[:, None], fan[None, :]))
    slope_x, slope_y = _gradient(surface.height - 0.5 * surface.canopy, fan, camera)

    def widen(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(values, (width, _SAMPLES), interpolation=cv2.INTER_LINEAR), np.float32)

    horizon = np.maximum.accumulate(widen((surface.height - np.float32(camera.z)) / _STEPS[:, None]), axis=0)
    slopes = camera.row_slopes()
    top = int(np.clip(np.searchsorted(-slopes, -float(horizon[-1].max())), 0, camera.height - 1))
    slopes = slopes[top:]
    # One sorted axis for all columns: column c occupies the interval around 100 * c (slopes stay within ±40).
    columns = np.arange(width)
    keys = (np.clip(horizon, -40, 40).astype(np.float64) + 100.0 * columns).T.ravel()
    wanted = np.clip(slopes, -40, 40).astype(np.float64)[:, None] + 100.0 * columns
    index = (np.searchsorted(keys, wanted.T.ravel()).reshape(width, -1).T - columns * _SAMPLES).astype(np.int32)
    seen = index < _SAMPLES
    after = np.clip(index, 1, _SAMPLES - 1)

    flat = after * np.int32(width) + columns.astype(np.int32)
    low, high = horizon.ravel()[flat - width], horizon.ravel()[flat]
    t = np.clip((slopes[:, None] - low) / np.maximum(high - low, 1e-6), 0, 1)
    # On a plane the inverse depth, not the depth, is linear in the slope.
    inverse = 1 / _STEPS
    depth = 1 / (inverse[after - 1] + t * (inverse[after] - inverse[after - 1]))
    depth[~seen] = FAR
    share = (depth - _STEPS[after - 1]) / (_STEPS[after] - _STEPS[after - 1])
    lateral = widen(surface.lateral).ravel()
    lateral = lateral[flat - width] + share * (lateral[flat] - lateral[flat - width])

    nearest = after * np.int32(coarse) + (columns * coarse // width).astype(np.int32)
    canopy = surface.canopy.ravel()[nearest]
    ground = (surface.height - surface.canopy).ravel()[nearest]
    crown = np.clip((np.float32(camera.z) + slopes[:, None] * depth - ground) / np.float32(_CROWN), 0, 1)
    water = surface.water.ravel()[nearest]
    across = np.tile(((columns + 0.5) * coarse / width - 0.5).astype(np.float32), (len(slopes), 1))
    along = (after - 1 + share).astype(np.float32)
    slope_x, slope_y = (
        np.asarray(cv2.remap(values, across, along, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)
        for values in (slope_x, slope_y)
    )
    x, y = camera.ground_points(depth, sideways[None, :])
    return Land(top, seen, depth, x, y, lateral, canopy, crown, water, slope_x, slope_y)


def _gradient(
    height: NDArray[np.float32], sideways: NDArray[np.float32], camera: Camera
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rise along x and y of samples that lie on the camera's fan of depths and column slopes, D × W."""
    (fx, fy), (rx, ry) = camera.forward, camera.right
    along, across = np.gradient(height, np.log(_STEPS), sideways)
    across = across / _STEPS[:, None]
    ahead = along / _STEPS[:, None] - across * sideways[None, :]
    return (ahead * fx + across * rx).astype(np.float32), (ahead * fy + across * ry).astype(np.float32)
