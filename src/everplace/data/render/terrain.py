"""The land: height, water and tree canopy anywhere in the world, and what of it a camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.data.render.camera import Camera
from everplace.data.render.noise import ramp, sample
from everplace.data.render.road import Column, Road

__all__ = ["FAR", "Land", "Surface", "Terrain", "View", "view_terrain"]

FAR = 6000.0
"""Depth in metres behind which there is only sky."""
_NEAR = 1.2
_SAMPLES = 150


class Surface(NamedTuple):
    """The surface at world positions; all arrays have the shape of the positions.

    Attributes:
        height: Height of what is seen, tree tops included, in metres.
        lateral: Signed distance from the middle of the road, left positive, in metres.
        canopy: Height of the closed forest's crowns above the ground, in metres; 0 outside forest.
        water: 1 on a lake, else 0.
    """

    height: NDArray[np.float32]
    lateral: NDArray[np.float32]
    canopy: NDArray[np.float32]
    water: NDArray[np.float32]


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
        left = lateral > 0
        away = np.abs(lateral)
        off_road = ramp(away, 5, 42)
        bank = np.where(left, row[..., Column.BANK_LEFT], row[..., Column.BANK_RIGHT])
        height = row[..., Column.HEIGHT] + off_road * (
            6.5 * sample(self.hills, x, y, 3.0) + bank * np.minimum(away, 90)
        )
        height += ramp(away, 130, 1300) * 120 * (1 - 1.6 * np.abs(sample(self.hills, x, y, 13.0)))
        height += ramp(away, 700, 3600) * 900 * (0.75 - np.abs(sample(self.hills, x, y, 41.0))) ** 2
        height -= 0.4 * np.exp(-(((away - 6.4) / 0.9) ** 2))

        lake = np.where(left, row[..., Column.LAKE_LEFT], row[..., Column.LAKE_RIGHT])
        shore = 5 * sample(self.detail, x, y, 1.5)
        bowl = lake * ramp(away + shore, 10, 22) * (1 - ramp(away + 4 * shore, 120, 220))
        level = row[..., Column.LEVEL]
        height += bowl * (level - 2 - height)
        water = ((height < level) & (bowl > 0.3)).astype(np.float32)
        height = np.where(water > 0, level, height)

        canopy = self._canopy(x, y, row, left, away) * (1 - np.minimum(bowl * 3, 1))
        return Surface((height + canopy).astype(np.float32), lateral, canopy.astype(np.float32), water)

    def _canopy(
        self,
        x: NDArray[np.float32],
        y: NDArray[np.float32],
        row: NDArray[np.float32],
        left: NDArray[np.bool_],
        away: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Closed forest behind the roadside trees of the woods, and copses on the hills."""
        wood = np.where(left, row[..., Column.WOOD_LEFT], row[..., Column.WOOD_RIGHT])
        edge = away + 5 * sample(self.detail, x, y, 1.1)
        beside = np.where(wood > 0.5, ramp(edge, 24, 27), 0)
        copses = ramp(sample(self.hills, y, x, 2.2) + 0.1 * sample(self.detail, x, y, 0.9), 0.16, 0.2)
        crowns = 1 + 0.32 * sample(self.detail, x, y, 0.7)
        return np.asarray(
            13 * crowns * np.maximum(beside * (away < 260), copses * ramp(away, 110, 125)), np.float32
        )

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
        crown: How high in the crowns the point lies: 0 at the foot of the forest, 1 at its top.
        water: Lake, 0 to 1.
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
    water: NDArray[np.float32]
    slope_x: NDArray[np.float32]
    slope_y: NDArray[np.float32]


class View(NamedTuple):
    """Terrain as one camera sees it.

    Attributes:
        land: What the pixels show.
        steps: Depths of the samples along each column, in metres (D).
        horizon: Highest slope (rise over depth) up to each sample, D × W: what lies lower and behind is hidden.
    """

    land: Land
    steps: NDArray[np.float32]
    horizon: NDArray[np.float32]


def view_terrain(terrain: Terrain, camera: Camera) -> View:
    """Finds for each pixel the first point of the terrain along its ray.

    Each image column is a vertical plane. Along it the terrain is sampled at depths that grow geometrically; the
    running maximum of the slope from the camera is sorted, so one binary search per pixel finds the sample that
    hides it.
    """
    width = camera.width
    steps = np.geomspace(_NEAR, FAR, _SAMPLES).astype(np.float32)
    sideways = camera.column_slopes()
    x, y = camera.ground_points(steps[:, None], sideways[None, :])
    surface = terrain.surface(x, y)
    rise = (surface.height - np.float32(camera.z)) / steps[:, None]
    horizon = np.maximum.accumulate(rise, axis=0)

    slopes = camera.row_slopes()
    top = int(np.clip(np.searchsorted(-slopes, -float(horizon[-1].max())), 0, camera.height - 1))
    slopes = slopes[top:]
    # One sorted axis for all columns: column c occupies the interval around 100 * c (slopes stay within ±40).
    columns = np.arange(width)
    bounded = np.clip(horizon, -40, 40).astype(np.float64)
    keys = (bounded + 100.0 * columns).T.ravel()
    wanted = np.clip(slopes, -40, 40).astype(np.float64)[:, None] + 100.0 * columns
    index = np.searchsorted(keys, wanted) - columns * _SAMPLES
    seen = index < _SAMPLES
    after = np.clip(index, 1, _SAMPLES - 1).astype(np.int32)

    flat = after * width + columns.astype(np.int32)
    low, high = horizon.ravel()[flat - width], horizon.ravel()[flat]
    t = np.clip((slopes[:, None] - low) / np.maximum(high - low, 1e-6), 0, 1)
    near, far = steps[after - 1], steps[after]
    # On a plane the inverse depth, not the depth, is linear in the slope.
    depth = 1 / (1 / near + t * (1 / far - 1 / near))
    depth = np.where(seen, depth, np.float32(FAR)).astype(np.float32)
    px, py = camera.ground_points(depth, sideways[None, :])

    def between(values: NDArray[np.float32]) -> NDArray[np.float32]:
        line = values.ravel()
        return np.asarray(line[flat - width] + t * (line[flat] - line[flat - width]), np.float32)

    canopy = surface.canopy.ravel()[flat]
    ground = between(surface.height - surface.canopy)
    crown = (np.float32(camera.z) + slopes[:, None] * depth - ground) / np.maximum(canopy, 1)
    slope_x, slope_y = _gradient(surface.height - 0.5 * surface.canopy, x, y, steps, sideways, camera)
    land = Land(
        top,
        seen,
        depth,
        px,
        py,
        between(surface.lateral),
        canopy,
        np.clip(crown, 0, 1),
        surface.water.ravel()[flat],
        slope_x.ravel()[flat],
        slope_y.ravel()[flat],
    )
    return View(land, steps, horizon)


def _gradient(
    height: NDArray[np.float32],
    x: NDArray[np.float32],
    y: NDArray[np.float32],
    steps: NDArray[np.float32],
    sideways: NDArray[np.float32],
    camera: Camera,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rise along x and y of samples that lie on the camera's fan of depths and column slopes, D × W."""
    along, across = np.gradient(height, np.log(steps), sideways)
    across = across / steps[:, None]
    ahead = along / steps[:, None] - across * sideways[None, :]
    slope_x = ahead * camera.forward[0] + across * camera.right[0]
    slope_y = ahead * camera.forward[1] + across * camera.right[1]
    return slope_x.astype(np.float32), slope_y.astype(np.float32)
