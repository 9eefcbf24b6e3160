"""Everything built, as flat faces and strokes: houses, barns, churches, poles, wires, fences, signs, bridges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Material", "Mesh", "MeshBuilder", "Pair", "Point", "Site", "upright"]

Pair = tuple[float, float]
Point = tuple[float, float, float]
_NOWHERE = (np.nan, np.nan, np.nan)


class Material(IntEnum):
    """What a face is made of, and its colour (RGB, 0 to 255) in full light."""

    colour: tuple[int, int, int]

    def __new__(cls, red: int, green: int, blue: int) -> Material:
        """Numbers the materials from 0 on, in their order."""
        number = len(cls.__members__)
        material = int.__new__(cls, number)
        material._value_ = number
        material.colour = (red, green, blue)
        return material

    PLASTER_WHITE = 226, 222, 212
    PLASTER_YELLOW = 222, 194, 132
    PLASTER_RED = 164, 78, 60
    PLASTER_GREY = 166, 166, 164
    BRICK = 150, 92, 72
    ROOF_TILE = 150, 74, 52
    ROOF_SLATE = 84, 86, 94
    GLASS = 58, 70, 84
    DOOR = 84, 58, 42
    WOOD = 124, 100, 76
    WOOD_RED = 136, 48, 38
    STONE = 150, 144, 134
    METAL = 150, 154, 158
    WHITE = 236, 236, 234
    RED = 200, 40, 36
    BLUE = 36, 84, 170
    YELLOW = 240, 200, 40
    WIRE = 52, 52, 56
    CONCRETE = 172, 170, 166
    LAMP = 236, 232, 214


class Mesh(NamedTuple):
    """Faces, ordered by the x of the object they belong to.

    A face is a quadrilateral (a triangle repeats its last corner); a stroke has its two ends in corners 0 and 1 and a
    thickness.

    Attributes:
        anchors: F × 2, ground position of the object the face belongs to: faces are drawn object by object.
        corners: F × 4 × 3 world points in metres.
        normals: F × 3 unit vectors outwards; zero where both sides show.
        materials: F, see `Material`.
        thickness: F, metres; 0 for faces.
        ranks: F, the order of drawing inside an object.
        reach: F, the depth in metres up to which the face is drawn.
        extent: F, the longest side in metres: a face that would be smaller than a pixel is not drawn.
        chance: F, a fixed random number in [0, 1) for each face (which windows are lit).
    """

    anchors: NDArray[np.float64]
    corners: NDArray[np.float64]
    normals: NDArray[np.float64]
    materials: NDArray[np.uint8]
    thickness: NDArray[np.float64]
    ranks: NDArray[np.int32]
    reach: NDArray[np.float64]
    extent: NDArray[np.float64]
    chance: NDArray[np.float64]

    def part(self, chosen: slice | NDArray[np.bool_]) -> Mesh:
        """Returns the chosen faces."""
        return Mesh._make(values[chosen] for values in self)

    def between(self, low: float, high: float) -> Mesh:
        """Returns the faces of the objects that stand from x = `low` to x = `high`."""
        return self.part(slice(*np.searchsorted(self.anchors[:, 0], (low, high))))


@dataclass(frozen=True, slots=True)
class MeshBuilder:
    """Collects faces object by object."""

    _rows: list[tuple[float, ...]] = field(default_factory=list)

    def add(
        self,
        points: Sequence[Point],
        material: Material,
        anchor: Pair,
        *,
        inside: Point = _NOWHERE,
        thickness: float = 0.0,
        rank: int = 0,
        reach: float,
    ) -> None:
        """Adds a flat face of 3 or 4 corners, or a stroke from one point to another.

        Args:
            points: The corners in order, in the world.
            material: What it is made of.
            anchor: Ground position of its object.
            inside: A point inside the object: the face shows its other side only. Left out: both sides show.
            thickness: Of a stroke, in metres.
            rank: Order of drawing inside the object, low first.
            reach: Depth up to which it is drawn, in metres.
        """
        corners = (points[0], points[1], points[-1] if len(points) == 2 else points[2], points[-1])
        flat = (coordinate for corner in corners for coordinate in corner)
        self._rows.append((*anchor, material, thickness, rank, reach, *inside, *flat))

    def build(self, rng: np.random.Generator) -> Mesh:
        """Returns the mesh, ordered by anchor, with a random number for each face."""
        rows = np.array(self._rows, np.float64).reshape(-1, 21)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        corners = rows[:, 9:].reshape(-1, 4, 3)
        return Mesh(
            anchors=rows[:, :2],
            corners=corners,
            normals=_outward(corners, rows[:, 6:9]),
            materials=rows[:, 2].astype(np.uint8),
            thickness=rows[:, 3],
            ranks=rows[:, 4].astype(np.int32),
            reach=rows[:, 5],
            extent=np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1),
            chance=rng.uniform(size=len(rows)),
        )


def _outward(corners: NDArray[np.float64], inside: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals of faces, away from a point inside their objects; zero where that point is not a number."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    inward = ((corners[:, 0] - inside) * normals).sum(axis=1) < 0
    normals[inward] *= -1
    normals[np.isnan(inside[:, 0])] = 0
    return normals


def upright(start: Pair, end: Pair, low: float, high: float) -> tuple[Point, Point, Point, Point]:
    """Returns the corners of an upright face over the line from `start` to `end` on the map."""
    return (*start, low), (*end, low), (*end, high), (*start, high)


@dataclass(frozen=True, slots=True)
class Site:
    """Where an object stands. Its faces are given in metres along and across its axis and above its ground.

    Attributes:
        mesh: Where its faces go.
        x: World position in metres.
        y: World position in metres.
        z: Height of the ground in metres.
        yaw: Direction of its axis in radians.
    """

    mesh: MeshBuilder
    x: float
    y: float
    z: float
    yaw: float

    @property
    def anchor(self) -> Pair:
        """Its ground position."""
        return self.x, self.y

    def point(self, along: float, across: float, up: float) -> Point:
        """Returns a point of the object in the world."""
        c, s = float(np.cos(self.yaw)), float(np.sin(self.yaw))
        return self.x + along * c - across * s, self.y + along * s + across * c, self.z + up

    def face(
        self,
        points: Sequence[Point],
        material: Material,
        *,
        inside: Point = _NOWHERE,
        rank: int = 0,
        reach: float = 420,
    ) -> None:
        """Adds a face, as `MeshBuilder.add` does."""
        corners = [self.point(*point) for point in points]
        self.mesh.add(corners, material, self.anchor, inside=self.point(*inside), rank=rank, reach=reach)

    def stroke(
        self, start: Point, end: Point, thickness: float, material: Material, *, rank: int = 0, reach: float = 200
    ) -> None:
        """Adds a line with a thickness in metres: a pole, a rail."""
        ends = self.point(*start), self.point(*end)
        self.mesh.add(ends, material, self.anchor, thickness=thickness, rank=rank, reach=reach)
