"""Draws plants, buildings and furniture over the land, from far to near."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.camera import Camera
from everplace.render.look import Look
from everplace.render.mesh import Material, Mesh
from everplace.render.planner import Plants
from everplace.render.sprites import LEVELS, SPRITE_SIZE, Nursery, Plant

__all__ = ["FacesInView", "Layers", "PlantsInView", "draw_scene", "visible_faces", "visible_plants"]

_NEAR = 0.4
# Land nearer than these depths is laid over the objects behind it again, so that hills hide what stands behind them.
_BANDS = (1500.0, 700.0, 400.0, 240.0, 160.0, 110.0, 75.0, 50.0, 34.0, 22.0, 14.0, 8.0)
_SHIFT = 4
_PALETTE = np.array([material.colour for material in Material], np.float64)


class Layers(NamedTuple):
    """A scene before the lens, at the resolution it is drawn in.

    Attributes:
        light: H × W × 3, RGB of 0 to 255 and above.
        depth: H × W, metres to what is seen; `terrain.FAR` in the sky.
    """

    light: NDArray[np.float32]
    depth: NDArray[np.float32]


class PlantsInView(NamedTuple):
    """Plants in view.

    Attributes:
        plants: n of them.
        boxes: n × 4, left, top, right and bottom in pixels.
        depths: n, metres.
    """

    plants: Plants
    boxes: NDArray[np.float64]
    depths: NDArray[np.float64]


class FacesInView(NamedTuple):
    """Faces in view.

    Attributes:
        mesh: n of them.
        local: n × 4 × 3, corners as (right, up, depth) in metres.
        depths: n, depth of the object for the order of drawing, in metres.
    """

    mesh: Mesh
    local: NDArray[np.float64]
    depths: NDArray[np.float64]


def visible_plants(plants: Plants, camera: Camera) -> PlantsInView:
    """Chooses and projects the plants in view; the far ones are thinned out, the same ones for every condition."""
    plants = plants.between(camera.x - 30, camera.x + 330)
    local = camera.local(plants.places)
    depth, height, width = local[:, 2], plants.sizes[:, 0], plants.sizes[:, 1]
    dense = np.clip(0.5 * camera.focal, 40, 90)  # metres up to which every plant is drawn
    keep = (depth > 1.2) & (depth < 330) & (plants.chance < dense / np.maximum(depth, 1))
    keep &= height * camera.focal > 2.5 * depth
    keep &= np.abs(local[:, 0]) - width < depth * (camera.width / 2 / camera.focal)
    depth = depth[keep]
    column, row = camera.project(local[keep]).T
    scale = camera.focal / depth
    half, tall = width[keep] * scale / 2, height[keep] * scale
    boxes = np.column_stack([column - half, row - tall, column + half, row + 0.01 * tall])
    return PlantsInView(plants.part(keep), boxes, depth)


def visible_faces(mesh: Mesh, camera: Camera) -> FacesInView:
    """Chooses the faces in view that show their outer side and are near enough to matter."""
    mesh = mesh.between(camera.x - 60, camera.x + 3000)
    depth = camera.depth(mesh.anchors)
    matters = (depth > -60) & (depth < np.minimum(mesh.reach, mesh.extent * camera.focal))
    mesh, depth = mesh.part(matters), depth[matters]
    local = camera.local(mesh.corners)
    x, z = local[..., 0], local[..., 2]
    half = camera.width / 2 / camera.focal
    inside = (np.abs(x) < half * np.maximum(z, _NEAR) + 0.5).any(axis=1)
    spans = (x.min(axis=1) < 0) & (x.max(axis=1) > 0)
    to_camera = np.array([camera.x, camera.y, camera.z]) - mesh.corners[:, 0]
    outer = ((mesh.normals * to_camera).sum(axis=1) > 0) | ~mesh.normals.any(axis=1)
    shows = (z.max(axis=1) > _NEAR) & (inside | spans) & outer
    return FacesInView(mesh.part(shows), local[shows], depth[shows])


def draw_scene(land: Layers, camera: Camera, plants: PlantsInView, faces: FacesInView, nursery: Nursery) -> Layers:
    """Draws plants and faces over the land.

    Args:
        land: The finished land and sky.
        camera: The camera.
        plants: Plants in view.
        faces: Faces in view.
        nursery: Has the look and the pictures of the plants.
    """
    land_colour = np.asarray(cv2.cvtColor(cv2.convertScaleAbs(land.light), cv2.COLOR_RGB2RGBA), np.uint8)
    colour, depth = land_colour.copy(), land.depth.copy()
    pastings, fillings = _pastings(plants, camera, nursery), _fillings(faces, camera, nursery.look)
    depths = np.concatenate([plants.depths, faces.depths])
    ranks = np.concatenate([np.zeros(len(pastings), np.int32), faces.mesh.ranks])
    bands = list(_BANDS)
    drawn = False
    for item in np.lexsort((ranks, -depths)):
        while bands and depths[item] < bands[0]:
            edge = bands.pop(0)
            if drawn:
                hides = (land.depth < edge).view(np.uint8)
                cv2.copyTo(land_colour, hides, colour)
                cv2.copyTo(land.depth, hides, depth)
                drawn = False
        drawn = True
        if item < len(pastings):
            _paste(colour, depth, pastings[item])
        else:
            _fill(colour, depth, fillings[item - len(pastings)])
    return Layers(cv2.cvtColor(colour, cv2.COLOR_RGBA2RGB).astype(np.float32), depth)


class _Filling(NamedTuple):
    """A projected face: corners in 1/16 pixel, thickness in pixels (0 for faces), mean depth, RGBA."""

    corners: NDArray[np.int32]
    thickness: float
    depth: float
    colour: list[float]


def _fillings(faces: FacesInView, camera: Camera, look: Look) -> list[_Filling]:
    def pixels(local: NDArray[np.float64]) -> NDArray[np.int32]:
        return np.round(camera.project(local) * (1 << _SHIFT)).astype(np.int32)

    near = np.maximum(faces.local, (-np.inf, -np.inf, _NEAR))
    corners = list(pixels(near))
    for face in np.flatnonzero((faces.local[..., 2] < _NEAR).any(axis=1)):
        corners[face] = pixels(_clip(faces.local[face]))
    depth = np.maximum(faces.local[..., 2].mean(axis=1), _NEAR)
    thickness = faces.mesh.thickness * camera.focal / depth
    colours = np.pad(_lit_colours(faces.mesh, look), ((0, 0), (0, 1)), constant_values=255)
    return [*map(_Filling, corners, thickness.tolist(), depth.tolist(), colours.tolist())]


def _lit_colours(mesh: Mesh, look: Look) -> NDArray[np.float64]:
    """Returns the colour of each face under a look, F × 3."""
    colours = _PALETTE[mesh.materials]
    glass = mesh.materials == Material.GLASS
    colours[glass] += (np.array(look.horizon) - colours[glass]) * 0.25
    colours *= (0.92 + 0.16 * mesh.chance)[:, None]
    upward = np.clip((mesh.normals[:, 2:] - 0.25) / 0.3, 0, 1)
    colours += (np.array((232, 236, 244)) - colours) * upward * look.snow
    colours *= 1 - 0.3 * look.wet * upward
    x, y = look.sunward
    level = np.cos(look.sun_elevation)
    sun = np.array((x * level, y * level, np.sin(look.sun_elevation)))
    facing = np.where(mesh.normals.any(axis=1), mesh.normals @ sun, 0.45)
    direct = look.sun * np.clip(1.25 * facing, 0, 1)[:, None]
    shade = np.array(look.shade_colour) * (0.86 + 0.14 * mesh.normals[:, 2:])
    return np.asarray(np.clip(colours * (shade + (np.array(look.sun_colour) - shade) * direct), 0, 255))


def _clip(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cuts a polygon off at the near plane (Sutherland-Hodgman)."""
    kept = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= _NEAR:
            kept.append(a)
        if (a[2] >= _NEAR) != (b[2] >= _NEAR):
            kept.append(a + (b - a) * (_NEAR - a[2]) / (b[2] - a[2]))
    return np.array(kept)


def _fill(colour: NDArray[np.uint8], depth: NDArray[np.float32], face: _Filling) -> None:
    if face.thickness == 0:
        cv2.fillConvexPoly(colour, face.corners, face.colour, cv2.LINE_AA, _SHIFT)
        cv2.fillConvexPoly(depth, face.corners, (face.depth,), cv2.LINE_8, _SHIFT)
    elif face.thickness > 0.15 and len(face.corners) > 1:
        start, end = face.corners[:2].tolist()
        width = min(255, max(1, round(face.thickness)))
        cv2.line(colour, start, end, face.colour, width, cv2.LINE_AA, _SHIFT)
        cv2.line(depth, start, end, (face.depth,), width, cv2.LINE_8, _SHIFT)


class _Pasting(NamedTuple):
    """A plant's picture (RGBA), the clipped box (x0, y0, x1, y1) it goes to, the 2 × 3 warp into it, its depth."""

    picture: NDArray[np.uint8]
    box: list[int]
    warp: NDArray[np.float64]
    depth: float


def _pastings(plants: PlantsInView, camera: Camera, nursery: Nursery) -> list[_Pasting]:
    left, top, right, bottom = plants.boxes.T
    tall, wide = bottom - top, right - left
    height, width = SPRITE_SIZE
    levels = np.clip(np.ceil(np.log2(height / (1.6 * np.maximum(tall, 1)))), 0, LEVELS - 1).astype(int)
    sx, sy = wide / (width >> levels), tall / (height >> levels)
    low = np.maximum(np.floor(plants.boxes[:, :2]), 0)
    high = np.minimum(np.floor(plants.boxes[:, 2:]) + 1, (camera.width, camera.height))
    warps = np.zeros((len(levels), 2, 3))
    warps[:, 0, 0], warps[:, 1, 1] = sx, sy
    warps[:, 0, 2] = left - low[:, 0] + 0.5 * sx - 0.5
    warps[:, 1, 2] = top - low[:, 1] + 0.5 * sy - 0.5
    from_left = bool(np.array(nursery.look.sunward) @ np.array(camera.right) < 0)
    pictures = (
        nursery.picture(Plant(kind), variant, from_left)[level]
        for kind, variant, level in zip(plants.plants.kinds, plants.plants.variants.tolist(), levels, strict=True)
    )
    boxes = np.hstack([low, high]).astype(int).tolist()
    return [*map(_Pasting, pictures, boxes, warps, plants.depths.tolist())]


def _paste(colour: NDArray[np.uint8], depth: NDArray[np.float32], plant: _Pasting) -> None:
    x0, y0, x1, y1 = plant.box
    if x1 <= x0 or y1 <= y0:
        return
    patch = cv2.warpAffine(plant.picture, plant.warp, (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
    alpha = patch[..., 3]
    opaque = cv2.bitwise_not(alpha)
    part = colour[y0:y1, x0:x1]
    cv2.multiply(part, cv2.merge((opaque, opaque, opaque, opaque)), part, 1 / 255)
    cv2.add(part, patch, part)
    np.copyto(depth[y0:y1, x0:x1], np.float32(plant.depth), where=alpha > 110)
