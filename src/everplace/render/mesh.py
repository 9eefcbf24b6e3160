"""Everything built, as flat faces and strokes: houses, barns, churches, poles, wires, fences, signs, bridges."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

__all__ = ["Material", "Mesh", "MeshBuilder", "Point"]

Point = tuple[float, float, float]


class Material(IntEnum):
    """What a face is made of; the look gives the colour."""

    PLASTER_WHITE = 0
    PLASTER_YELLOW = 1
    PLASTER_RED = 2
    PLASTER_GREY = 3
    BRICK = 4
    ROOF_TILE = 5
    ROOF_SLATE = 6
    GLASS = 7
    DOOR = 8
    WOOD = 9
    WOOD_RED = 10
    STONE = 11
    METAL = 12
    WHITE = 13
    RED = 14
    BLUE = 15
    YELLOW = 16
    WIRE = 17
    CONCRETE = 18
    LAMP = 19


@dataclass(frozen=True, slots=True)
class Mesh:
    """All faces of the world, ordered by the x of the object they belong to.

    A face is a quadrilateral (a triangle repeats its last corner); a stroke has its two ends in corners 0 and 1 and a
    thickness.

    Attributes:
        corners: F × 4 × 3 world points in metres.
        normals: F × 3 unit vectors outwards; zero where both sides show.
        materials: F, see `Material`.
        thickness: F, metres; 0 for faces.
        anchors: F × 2, ground position of the object the face belongs to: faces are drawn object by object.
        ranks: F, the order of drawing inside an object.
        extent: F, the longest side in metres: a face that would be smaller than a pixel is not drawn.
        reach: F, the depth in metres up to which the face is drawn.
        chance: F, a fixed random number in [0, 1) for each face (which windows are lit).
    """

    corners: NDArray[np.float64]
    normals: NDArray[np.float64]
    materials: NDArray[np.uint8]
    thickness: NDArray[np.float64]
    anchors: NDArray[np.float64]
    ranks: NDArray[np.int32]
    extent: NDArray[np.float64]
    reach: NDArray[np.float64]
    chance: NDArray[np.float64]


@dataclass(slots=True)
class MeshBuilder:
    """Collects faces object by object.

    Attributes:
        rng: Source of each face's fixed random number.
    """

    rng: np.random.Generator
    _corners: list[tuple[Point, Point, Point, Point]] = field(default_factory=list)
    _inside: list[Point] = field(default_factory=list)
    _rest: list[tuple[int, float, float, float, int, float]] = field(default_factory=list)

    def face(
        self,
        points: tuple[Point, ...],
        material: Material,
        anchor: tuple[float, float],
        *,
        inside: Point | None = None,
        rank: int = 0,
        reach: float = 420.0,
    ) -> None:
        """Adds a flat face of 3 or 4 corners.

        Args:
            points: The corners in order.
            material: What it is made of.
            anchor: Ground position of its object.
            inside: A point inside the object: the face shows its other side only. None: both sides show.
            rank: Order of drawing inside the object, low first.
            reach: Depth up to which it is drawn, in metres.
        """
        quad = (points[0], points[1], points[2], points[-1])
        self._add(quad, inside, material, 0.0, anchor, rank, reach)

    def stroke(
        self,
        start: Point,
        end: Point,
        thickness: float,
        material: Material,
        anchor: tuple[float, float],
        *,
        rank: int = 0,
        reach: float = 200.0,
    ) -> None:
        """Adds a line with a thickness in metres: a pole, a rail, a wire."""
        self._add((start, end, end, end), None, material, thickness, anchor, rank, reach)

    def _add(
        self,
        quad: tuple[Point, Point, Point, Point],
        inside: Point | None,
        material: Material,
        thickness: float,
        anchor: tuple[float, float],
        rank: int,
        reach: float,
    ) -> None:
        self._corners.append(quad)
        self._inside.append(inside or (np.nan, np.nan, np.nan))
        self._rest.append((int(material), thickness, anchor[0], anchor[1], rank, reach))

    def build(self) -> Mesh:
        """Returns the mesh, ordered by anchor."""
        rest = np.array(self._rest, np.float64).reshape(-1, 6)
        order = np.argsort(rest[:, 2], kind="stable")
        corners = np.array(self._corners, np.float64).reshape(-1, 4, 3)[order]
        normals = _outward(corners, np.array(self._inside, np.float64).reshape(-1, 3)[order])
        rest = rest[order]
        return Mesh(
            corners,
            normals,
            rest[:, 0].astype(np.uint8),
            rest[:, 1],
            rest[:, 2:4],
            rest[:, 4].astype(np.int32),
            np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1),
            rest[:, 5],
            self.rng.uniform(size=len(rest)),
        )


def _outward(corners: NDArray[np.float64], inside: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of faces, away from a point inside their objects; zero where that point is not a number."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    inward = ((corners[:, 0] - inside) * normals).sum(axis=1) < 0
    normals[inward] *= -1
    normals[np.isnan(inside[:, 0])] = 0
    return normals
