"""Draws plants, buildings and furniture over the land, from far to near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.camera import Camera
from everplace.render.look import Look
from everplace.render.mesh import Material, Mesh
from everplace.render.scenery import Plants
from everplace.render.sprites import LEVELS, SPRITE_SIZE, Nursery, Plant, Sprite

__all__ = ["Canvas", "Faces", "Standing", "draw_scene", "paint_faces", "visible_faces", "visible_plants"]

_NEAR = 0.4
# Land nearer than these depths is laid over the objects behind it again, so that hills hide what stands behind them.
_BANDS = (1500.0, 700.0, 400.0, 240.0, 160.0, 110.0, 75.0, 50.0, 34.0, 22.0, 14.0, 8.0)
_SHIFT = 4

_COLOURS: dict[Material, tuple[float, float, float]] = {
    Material.PLASTER_WHITE: (226, 222, 212),
    Material.PLASTER_YELLOW: (222, 194, 132),
    Material.PLASTER_RED: (164, 78, 60),
    Material.PLASTER_GREY: (166, 166, 164),
    Material.BRICK: (150, 92, 72),
    Material.ROOF_TILE: (150, 74, 52),
    Material.ROOF_SLATE: (84, 86, 94),
    Material.GLASS: (58, 70, 84),
    Material.DOOR: (84, 58, 42),
    Material.WOOD: (124, 100, 76),
    Material.WOOD_RED: (136, 48, 38),
    Material.STONE: (150, 144, 134),
    Material.METAL: (150, 154, 158),
    Material.WHITE: (236, 236, 234),
    Material.RED: (200, 40, 36),
    Material.BLUE: (36, 84, 170),
    Material.YELLOW: (240, 200, 40),
    Material.WIRE: (52, 52, 56),
    Material.CONCRETE: (172, 170, 166),
    Material.LAMP: (236, 232, 214),
}
_PALETTE = np.array([_COLOURS[material] for material in Material], np.float64)


@dataclass(slots=True)
class Canvas:
    """The image while it is painted.

    Attributes:
        colour: H × W × 4, uint8, RGB and an unused channel.
        depth: H × W, metres to what each pixel shows.
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.float32]


class Standing(NamedTuple):
    """Plants in view.

    Attributes:
        kinds: n, see `Plant`.
        variants: n.
        boxes: n × 4, left, top, right and bottom in pixels.
        depths: n, metres.
    """

    kinds: NDArray[np.uint8]
    variants: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    depths: NDArray[np.float64]


class Faces(NamedTuple):
    """Faces in view.

    Attributes:
        chosen: n, which faces of the mesh.
        local: n × 4 × 3, corners as (right, up, depth) in metres.
        depths: n, depth of the object for the order of drawing, in metres.
    """

    chosen: NDArray[np.intp]
    local: NDArray[np.float64]
    depths: NDArray[np.float64]


def visible_plants(plants: Plants, camera: Camera) -> Standing:
    """Chooses and projects the plants in view; the far ones are thinned out, the same ones for every condition."""
    first, last = np.searchsorted(plants.places[:, 0], (camera.x - 30, camera.x + 330))
    part = slice(int(first), int(last))
    local = camera.local(plants.places[part])
    depth, size = local[:, 2], plants.sizes[part]
    dense = np.clip(0.5 * camera.focal, 40, 90)  # metres up to which every plant is drawn
    keep = (depth > 1.2) & (depth < 330) & (plants.chance[part] < dense / np.maximum(depth, 1))
    keep &= size[:, 0] * camera.focal > 2.5 * depth
    keep &= np.abs(local[:, 0]) - size[:, 1] < depth * (camera.width / 2 / camera.focal)
    local, size, depth = local[keep], size[keep], depth[keep]
    foot = camera.project(local)
    scale = camera.focal / depth
    half, tall = size[:, 1] * scale / 2, size[:, 0] * scale
    boxes = np.column_stack([foot[:, 0] - half, foot[:, 1] - tall, foot[:, 0] + half, foot[:, 1] + 0.01 * tall])
    return Standing(plants.kinds[part][keep], plants.variants[part][keep], boxes, depth)


def visible_faces(mesh: Mesh, camera: Camera) -> Faces:
    """Chooses the faces in view that show their outer side and are near enough to matter."""
    first, last = np.searchsorted(mesh.anchors[:, 0], (camera.x - 60, camera.x + 3000))
    index = np.arange(first, last)
    anchors = mesh.anchors[index]
    (fx, fy), _ = camera.forward, camera.right
    depth = (anchors[:, 0] - camera.x) * fx + (anchors[:, 1] - camera.y) * fy
    matters = (depth > -60) & (depth < np.minimum(mesh.reach[index], mesh.extent[index] * camera.focal))
    index, depth = index[matters], depth[matters]
    local = camera.local(mesh.corners[index])
    half = camera.width / 2 / camera.focal
    z = local[..., 2]
    ahead = (z.max(axis=1) > _NEAR) & (np.abs(local[..., 0]) < half * np.maximum(z, _NEAR) + 0.5).any(axis=1)
    spans = (local[..., 0].min(axis=1) < 0) & (local[..., 0].max(axis=1) > 0) & (z.max(axis=1) > _NEAR)
    normals = mesh.normals[index]
    to_camera = np.array([camera.x, camera.y, camera.z]) - mesh.corners[index, 0]
    facing = (normals * to_camera).sum(axis=1)
    shows = (ahead | spans) & ((facing > 0) | ~normals.any(axis=1))
    return Faces(index[shows], local[shows], depth[shows])


def paint_faces(mesh: Mesh, faces: Faces, look: Look) -> NDArray[np.float64]:
    """Returns the colour of each face in view, n × 3, lit."""
    normals, materials = mesh.normals[faces.chosen], mesh.materials[faces.chosen]
    colours = _PALETTE[materials]
    glass = materials == Material.GLASS
    colours[glass] += (np.array(look.horizon) - colours[glass]) * 0.25
    colours *= (0.92 + 0.16 * mesh.chance[faces.chosen])[:, None]
    upward = np.clip((normals[:, 2] - 0.25) / 0.3, 0, 1)[:, None]
    colours += (np.array((232, 236, 244)) - colours) * upward * look.snow
    colours *= 1 - 0.3 * look.wet * upward
    c = np.cos(look.sun_elevation)
    sun = (np.cos(look.sun_azimuth) * c, np.sin(look.sun_azimuth) * c, np.sin(look.sun_elevation))
    facing = np.where(normals.any(axis=1), normals @ np.array(sun), 0.45)
    direct = look.sun * np.clip(1.25 * facing, 0, 1)[:, None]
    shade = np.array(look.shade_colour) * (0.86 + 0.14 * normals[:, 2:3])
    return np.asarray(np.clip(colours * (shade + (np.array(look.sun_colour) - shade) * direct), 0, 255))


def draw_scene(
    canvas: Canvas,
    camera: Camera,
    plants: Standing,
    faces: Faces,
    mesh: Mesh,
    colours: NDArray[np.float64],
    nursery: Nursery,
    from_left: bool,
) -> None:
    """Draws plants and faces onto the canvas, in place.

    Args:
        canvas: Holds the finished land and sky.
        camera: The camera.
        plants: Plants in view.
        faces: Faces in view.
        mesh: The mesh the faces belong to.
        colours: Colour of each face, n × 3.
        nursery: Has the pictures of the plants.
        from_left: Whether the light comes from the left.
    """
    land, land_depth = canvas.colour.copy(), canvas.depth.copy()
    polygons, pastings = _polygons(faces, mesh, camera), _pastings(plants, camera)
    depths = np.concatenate([plants.depths, faces.depths])
    ranks = np.concatenate([np.zeros(len(plants.depths), np.int32), mesh.ranks[faces.chosen]])
    order = np.lexsort((ranks, -depths))
    bands = list(_BANDS)
    drawn = False
    for item in order:
        while bands and depths[item] < bands[0]:
            edge = bands.pop(0)
            if drawn:
                hides = (land_depth < edge).view(np.uint8)
                cv2.copyTo(land, hides, canvas.colour)
                cv2.copyTo(land_depth, hides, canvas.depth)
                drawn = False
        drawn = True
        if item < len(plants.depths):
            sprite = nursery.picture(Plant(int(plants.kinds[item])), int(plants.variants[item]), from_left)
            _paste(canvas, sprite, pastings, item, float(plants.depths[item]))
        else:
            _fill(canvas, polygons, item - len(plants.depths), colours)


class _Polygons(NamedTuple):
    """Projected faces: corners in 1/16 pixel, thickness in pixels (0 for faces), mean depth, need of clipping."""

    corners: NDArray[np.int32]
    thickness: NDArray[np.float64]
    depth: NDArray[np.float64]
    clipped: dict[int, NDArray[np.int32]]


def _polygons(faces: Faces, mesh: Mesh, camera: Camera) -> _Polygons:
    local = faces.local
    safe = local.copy()
    safe[..., 2] = np.maximum(safe[..., 2], _NEAR)
    corners = np.round(camera.project(safe) * (1 << _SHIFT)).astype(np.int32)
    depth = np.maximum(local[..., 2].mean(axis=1), _NEAR)
    clipped = {}
    for face in np.flatnonzero((local[..., 2] < _NEAR).any(axis=1)):
        kept = _clip(local[face])
        clipped[int(face)] = np.round(camera.project(kept) * (1 << _SHIFT)).astype(np.int32)
    thickness = mesh.thickness[faces.chosen] * camera.focal / depth
    return _Polygons(corners, thickness, depth, clipped)


def _clip(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cuts a polygon off at the near plane (Sutherland-Hodgman)."""
    kept = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if a[2] >= _NEAR:
            kept.append(a)
        if (a[2] >= _NEAR) != (b[2] >= _NEAR):
            kept.append(a + (b - a) * (_NEAR - a[2]) / (b[2] - a[2]))
    return np.array(kept)


def _fill(canvas: Canvas, polygons: _Polygons, face: int, colours: NDArray[np.float64]) -> None:
    r, g, b = colours[face]
    colour, depth = (float(r), float(g), float(b), 255.0), float(polygons.depth[face])
    corners = polygons.clipped.get(face, polygons.corners[face])
    thickness = float(polygons.thickness[face])
    if thickness == 0:
        cv2.fillConvexPoly(canvas.colour, corners, colour, cv2.LINE_AA, _SHIFT)
        cv2.fillConvexPoly(canvas.depth, corners, (depth,), cv2.LINE_8, _SHIFT)
    elif thickness > 0.15 and len(corners) > 1:
        start, end = corners[0].tolist(), corners[1].tolist()
        width = min(255, max(1, round(thickness)))
        cv2.line(canvas.colour, start, end, colour, width, cv2.LINE_AA, _SHIFT)
        cv2.line(canvas.depth, start, end, (depth,), width, cv2.LINE_8, _SHIFT)


class _Pasting(NamedTuple):
    """Where each plant's picture goes: level of the sprite, clipped box (x0, y0, x1, y1) and 2 × 3 warp into it."""

    levels: list[int]
    boxes: list[list[int]]
    warps: NDArray[np.float64]


def _pastings(plants: Standing, camera: Camera) -> _Pasting:
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
    return _Pasting(levels.tolist(), np.hstack([low, high]).astype(int).tolist(), warps)


def _paste(canvas: Canvas, sprite: Sprite, pasting: _Pasting, item: int, depth: float) -> None:
    x0, y0, x1, y1 = pasting.boxes[item]
    if x1 <= x0 or y1 <= y0:
        return
    picture = sprite.levels[pasting.levels[item]]
    patch = cv2.warpAffine(picture, pasting.warps[item], (x1 - x0, y1 - y0), flags=cv2.INTER_LINEAR)
    alpha = patch[..., 3]
    opaque = cv2.bitwise_not(alpha)
    part = canvas.colour[y0:y1, x0:x1]
    cv2.multiply(part, cv2.merge((opaque, opaque, opaque, opaque)), part, 1 / 255)
    cv2.add(part, patch, part)
    np.copyto(canvas.depth[y0:y1, x0:x1], np.float32(depth), where=alpha > 110)
