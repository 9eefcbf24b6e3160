"""Light between things: shadows on the ground, haze, reflections, and a night lit by lamps and headlights."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.render.camera import Camera
from everplace.render.look import Look
from everplace.render.mesh import Material, Mesh
from everplace.render.painter import FacesInView
from everplace.render.planner import Plants
from everplace.render.terrain import FAR
from everplace.render.world import World

__all__ = ["add_haze", "add_reflections", "cast_shadows", "light_night"]

Image = NDArray[np.float32]

_SHADOW_REACH = 130.0
_LIT_WINDOWS = 0.55


def cast_shadows(world: World, camera: Camera, look: Look) -> Image:
    """Draws the shadows of plants and walls onto the ground.

    Returns:
        H × W, share of the direct light taken away; all 0 without sun.
    """
    mask = np.zeros((camera.height, camera.width), np.uint8)
    if look.sun < 0.2:
        return mask.astype(np.float32)
    length = min(1 / np.tan(look.sun_elevation), 4.5)
    away = (-look.sunward[0], -look.sunward[1])
    crowns = _crowns(world.plants, camera, away, length)
    walls = np.repeat(_walls(world.mesh, camera, away, length), 2, axis=1)
    outline = np.concatenate([crowns, walls])
    if len(outline):
        # The ground is taken as a slope between the foot of the object and the far end of its shadow.
        points, share = outline[..., :2], outline[..., 3:]
        tips = points[np.arange(len(points)), share[..., 0].argmax(axis=1)]
        far = world.terrain.height_at(tips[:, 0], tips[:, 1])[:, None, None]
        ground = outline[..., 2:3] + share * (far - outline[..., 2:3])
        local = camera.local(np.concatenate([points, ground], axis=-1))
        local = local[(local[..., 2] > 0.5).any(axis=1)]
        local[..., 2] = np.maximum(local[..., 2], 0.5)
        for polygon in np.round(camera.project(local) * 16).astype(np.int32):
            cv2.fillConvexPoly(mask, cv2.convexHull(polygon), 255, cv2.LINE_AA, 4)
    blur = max(1, camera.width // 200) * 2 + 1
    return cv2.blur(mask, (blur, 3)).astype(np.float32) * np.float32(0.9 / 255)


def _crowns(plants: Plants, camera: Camera, away: tuple[float, float], length: float) -> NDArray[np.float64]:
    """Outlines of the plants' shadows, n × 8 × 4: map position, height of the foot, share of the shadow's length."""
    plants = plants.between(camera.x - 70, camera.x + _SHADOW_REACH)
    side, _, depth = camera.local(plants.places).T
    keep = (depth > -45) & (depth < _SHADOW_REACH) & (np.abs(side) < 0.8 * np.abs(depth) + 50)
    places, sizes = plants.places[keep], plants.sizes[keep]
    turns = np.linspace(0, 2 * np.pi, 9)[:-1]
    reach = np.broadcast_to(0.56 + 0.44 * np.cos(turns), (len(places), 8))
    along = sizes[:, :1] * length * reach
    across = sizes[:, 1:] * (0.40 * np.sin(turns))
    x = places[:, :1] + along * away[0] - across * away[1]
    y = places[:, 1:2] + along * away[1] + across * away[0]
    return np.stack([x, y, np.broadcast_to(places[:, 2:], x.shape), reach], axis=-1)


def _walls(mesh: Mesh, camera: Camera, away: tuple[float, float], length: float) -> NDArray[np.float64]:
    """Outlines of the shadows of walls, roofs, posts and poles, n × 4 × 4: as for the crowns."""
    mesh = mesh.between(camera.x - 40, camera.x + _SHADOW_REACH)
    depth = camera.depth(mesh.anchors)
    panes = (mesh.ranks == 2) | (mesh.materials == Material.WHITE)
    posts, wires = mesh.thickness > 0.05, mesh.materials == Material.WIRE
    corners = mesh.corners[(depth > -30) & (depth < _SHADOW_REACH) & (posts | ~panes) & ~wires]
    foot = corners[..., 2:].min(axis=1, keepdims=True)
    rise = corners[..., 2:] - foot
    points = corners[..., :2] + rise * length * np.array(away)
    share = rise / np.maximum(rise.max(axis=1, keepdims=True), 1e-6)
    return np.concatenate([points, np.broadcast_to(foot, rise.shape), share], axis=-1)


def add_haze(image: Image, depth: Image, look: Look) -> None:
    """Blends everything but the sky into the haze by its depth, in place."""
    clear = np.exp(depth * np.float32(-1 / look.haze))
    clear[depth >= FAR] = 1
    haze = np.array(look.horizon, np.float32)
    image -= haze
    image *= clear[..., None]
    image += haze


def add_reflections(image: Image, mirror: Image, camera: Camera, look: Look) -> None:
    """Mirrors the scene about the horizon in water and on the wet road, in place."""
    rows, columns = np.nonzero(mirror > 0.02)
    if not len(rows):
        return
    ripple = max(3, camera.height // 24) | 1
    smeared = cv2.blur(image, (3, ripple))
    level = camera.centre_row
    source = np.clip(2 * level - rows, 0, max(level - 1, 0)).astype(np.intp)
    # Grazing light is reflected most (Fresnel): the farther, the stronger.
    grazing = np.clip(1 - (rows - level) / (0.75 * camera.height), 0.15, 1)
    share = (mirror[rows, columns] * grazing).astype(np.float32)[:, None]
    reflected = smeared[source, columns] * np.float32(1.0 if look.dark else 0.9)
    image[rows, columns] += (reflected - image[rows, columns]) * share


def light_night(image: Image, depth: Image, camera: Camera, faces: FacesInView) -> Image:
    """Turns evenly lit colours into night: headlights, street lamps, lit windows and their glow.

    Args:
        image: H × W × 3, RGB as under an overcast sky; the sky is already dark.
        depth: H × W in metres.
        camera: The camera.
        faces: Faces in view.
    """
    u, v = camera.column_slopes()[None, :], camera.row_slopes()[:, None]
    beam = np.exp(-((u / 0.42) ** 2)) * (1 / (1 + np.exp((v - 0.015 - 0.05 * u) / 0.02)) + 0.05)
    light = (1.25 * beam / (0.5 + (depth / 26) ** 2))[..., None] * np.array((1.0, 0.96, 0.84), np.float32)
    light = light + np.array((0.085, 0.10, 0.14), np.float32)
    lamps, glow = np.zeros_like(image), np.zeros_like(image)
    materials, chance = faces.mesh.materials, faces.mesh.chance
    shines = (materials == Material.LAMP) | ((materials == Material.GLASS) & (chance < _LIT_WINDOWS))
    for face in np.flatnonzero(shines & (faces.local[..., 2].min(axis=1) > 0.5)):
        if materials[face] == Material.LAMP:
            _pool(lamps, depth, camera, faces.local[face])
        _shine(glow, depth, camera, faces.local[face], materials[face] == Material.LAMP, float(chance[face]))
    sky = (depth >= FAR)[..., None]
    lit = np.where(sky, image, image * (light + lamps)) + glow
    small = cv2.resize(glow, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    halo = cv2.GaussianBlur(small, (0, 0), max(1.0, camera.width / 160))
    lit += 1.3 * cv2.resize(halo, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(lit, np.float32)


def _pool(lamps: Image, depth: Image, camera: Camera, local: NDArray[np.float64]) -> None:
    """Adds the light of one street lamp to whatever is near it."""
    at = local[0]
    column, row = camera.project(at)
    reach = 12 * (camera.focal / at[2])
    x0, x1 = np.clip((int(column - reach), int(column + reach) + 1), 0, camera.width)
    y0, y1 = np.clip((int(row - 0.3 * reach), int(row + reach) + 1), 0, camera.height)
    z = depth[y0:y1, x0:x1]
    right = (np.arange(x0, x1) + 0.5 - camera.width / 2)[None, :] * z / np.float32(camera.focal)
    up = (camera.centre_row - np.arange(y0, y1) - 0.5)[:, None] * z / np.float32(camera.focal)
    distance = (right - at[0]) ** 2 + (up - at[1]) ** 2 + (z - at[2]) ** 2
    strength = (28 / (18 + distance) * np.clip(1.6 - np.sqrt(distance) / 9, 0, 1)).astype(np.float32)
    lamps[y0:y1, x0:x1] += strength[..., None] * np.array((1.0, 0.78, 0.46), np.float32)


def _shine(glow: Image, depth: Image, camera: Camera, local: NDArray[np.float64], lamp: bool, chance: float) -> None:
    """Draws a lit window or lamp where nothing nearer hides it."""
    corners = camera.project(local)
    size = max(1.5, 0.16 * camera.focal / float(local[:, 2].mean()))
    grown = int(size) + 2 if lamp else 2
    box = np.floor(corners.min(axis=0)) - grown, np.ceil(corners.max(axis=0)) + grown
    (x0, y0), (x1, y1) = np.clip(box, 0, (camera.width, camera.height)).astype(int)
    if x0 >= x1 or y0 >= y1:
        return
    mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
    points = np.round((corners - (x0, y0)) * 16).astype(np.int32)
    if lamp:
        cv2.circle(mask, points[:2].mean(axis=0).astype(int).tolist(), int(size * 16), 255, -1, cv2.LINE_AA, 4)
    else:
        cv2.fillConvexPoly(mask, points, 255, cv2.LINE_AA, 4)
    mask[depth[y0:y1, x0:x1] < local[:, 2].min() - 1.0] = 0
    warm = np.array((255, 226, 160) if lamp else (235, 176 + 60 * (chance - 0.27), 92), np.float32)
    part = glow[y0:y1, x0:x1]
    np.maximum(part, mask[..., None] * (warm / 255), out=part)
