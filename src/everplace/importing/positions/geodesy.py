"""From satellite positions to metres in a plane, and the heading of a track."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["local_plane", "track_headings"]

_SEMI_MAJOR = 6_378_137.0
_FLATTENING = 1 / 298.257223563


def local_plane(degrees: NDArray[np.float64], origin: tuple[float, float]) -> NDArray[np.float64]:
    """Projects latitudes and longitudes (WGS 84) onto the plane that touches the ellipsoid at the origin.

    x = (λ - λ₀) N cos φ₀ and y = (φ - φ₀) M, with the ellipsoid's radii of curvature N and M at the origin:
    10 km away it is wrong by about ten metres, and for two drives along the same road by the same ten metres.

    Args:
        degrees: K×2, latitude and longitude in degrees.
        origin: Latitude and longitude of the plane's origin; the same for all drives that are compared.

    Returns:
        K×2 metres: x to the east, y to the north.
    """
    latitude = np.radians(origin[0])
    square = _FLATTENING * (2 - _FLATTENING)
    bent = 1 - square * np.sin(latitude) ** 2
    prime_vertical = _SEMI_MAJOR / np.sqrt(bent)
    meridian = _SEMI_MAJOR * (1 - square) / bent**1.5
    east = (degrees[:, 1] - origin[1] + 180.0) % 360.0 - 180.0  # across the date line the short way round
    x = np.radians(east) * prime_vertical * np.cos(latitude)
    y = np.radians(degrees[:, 0] - origin[0]) * meridian
    return np.column_stack([x, y])


def track_headings(positions: NDArray[np.float64], *, step: float = 1.0) -> NDArray[np.float64]:
    """Returns the direction of travel at each position, from the positions at least `step` metres away.

    Args:
        positions: K×2 metres, in the order of travel.
        step: Metres; shorter ways are noise of the receiver. A drive that never moves so far has heading 0.

    Returns:
        K radians, counter-clockwise from the x axis.
    """
    # Anchors: positions a step apart. Each position gets the direction from the anchor before to the one after.
    anchors = [0] if len(positions) else []
    for index in range(1, len(positions)):
        if np.hypot(*(positions[index] - positions[anchors[-1]])) >= step:
            anchors.append(index)
    if len(anchors) < 2:
        return np.zeros(len(positions))
    behind = np.searchsorted(anchors, np.arange(len(positions)), side="right") - 1
    behind = np.minimum(behind, len(anchors) - 2)
    ways = np.diff(positions[anchors], axis=0)[behind]
    headings: NDArray[np.float64] = np.arctan2(ways[:, 1], ways[:, 0])
    return headings
