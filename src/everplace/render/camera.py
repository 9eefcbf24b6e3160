"""The pinhole camera on the vehicle: where a world point falls in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera"]


@dataclass(frozen=True, slots=True)
class Camera:
    """A level pinhole camera whose pitch is a shift of the image, so verticals stay vertical.

    Attributes:
        x: Position in metres.
        y: Position in metres.
        z: Height of the optical centre in metres.
        heading: Radians, counter-clockwise from the x axis.
        pitch: Slope (rise over depth) of the road ahead, which the camera follows.
        height: Image height in pixels.
        width: Image width in pixels.
    """

    x: float
    y: float
    z: float
    heading: float
    pitch: float
    height: int
    width: int

    @property
    def focal(self) -> float:
        """Focal length in pixels: about 70° of horizontal view at 4:3, the same content at every size."""
        return 0.44 * (self.height + self.width)

    @property
    def centre_row(self) -> float:
        """Image row of the horizon of a flat world."""
        return 0.46 * self.height + self.focal * self.pitch

    @property
    def forward(self) -> tuple[float, float]:
        """Unit vector of the optical axis on the ground."""
        return float(np.cos(self.heading)), float(np.sin(self.heading))

    @property
    def right(self) -> tuple[float, float]:
        """Unit vector to the right of the optical axis on the ground."""
        return float(np.sin(self.heading)), -float(np.cos(self.heading))

    def column_slopes(self) -> NDArray[np.float32]:
        """Metres to the right per metre of depth, for each image column."""
        return ((np.arange(self.width) + 0.5 - self.width / 2) / self.focal).astype(np.float32)

    def row_slopes(self) -> NDArray[np.float32]:
        """Metres of rise per metre of depth, for each image row, falling."""
        return ((self.centre_row - np.arange(self.height) - 0.5) / self.focal).astype(np.float32)

    def ground_points(
        self, depth: NDArray[np.float32], sideways: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns world x and y at a depth (metres) and column slope; the two arrays are broadcast."""
        (fx, fy), (rx, ry) = self.forward, self.right
        x = np.float32(self.x) + depth * (np.float32(fx) + sideways * np.float32(rx))
        y = np.float32(self.y) + depth * (np.float32(fy) + sideways * np.float32(ry))
        return x, y

    def depth(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns how far world points (... × 2 or 3, metres) lie along the optical axis."""
        fx, fy = self.forward
        return np.asarray((points[..., 0] - self.x) * fx + (points[..., 1] - self.y) * fy)

    def local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turns world points (... × 3, metres) into (right, up, depth) as seen from the camera."""
        rx, ry = self.right
        side = (points[..., 0] - self.x) * rx + (points[..., 1] - self.y) * ry
        return np.stack([side, points[..., 2] - self.z, self.depth(points)], axis=-1)

    def project(self, local: NDArray[np.float64]) -> NDArray[np.float64]:
        """Projects (right, up, depth) with positive depth to (column, row) in pixels, edges of the image at 0."""
        scale = self.focal / local[..., 2]
        column = self.width / 2 + local[..., 0] * scale
        row = self.centre_row - local[..., 1] * scale
        return np.clip(np.stack([column, row], axis=-1), -8000, 8000)
