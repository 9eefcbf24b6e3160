"""The colour of the land: road, verge, fields, forest, water, in a condition's light."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.render.look import Colour, Look
from everplace.render.noise import TILE, ramp, sample
from everplace.render.road import WOODS, Biome, Column
from everplace.render.terrain import Land
from everplace.render.world import World

__all__ = ["paint_ground"]

Image = NDArray[np.float32]
Real = NDArray[np.floating[Any]]

_HALF_ROAD = 3.5
_CURB = 5.6


def paint_ground(world: World, land: Land, look: Look, shadow: Image, focal: float) -> tuple[Image, Image]:
    """Paints the visible land.

    Args:
        world: Gives the road and the textures.
        land: The visible land, rows × W.
        look: The appearance.
        shadow: rows × W, share of the direct light that objects take away.
        focal: Focal length in pixels; fades textures too fine for a pixel.

    Returns:
        The lit colour, rows × W × 3, RGB in 0 to 255, and how much the ground mirrors, rows × W, 0 (dull) to 1.
    """
    row, fraction = world.road.rows(land.x)
    arc = world.road.table[:, Column.ARC]
    footprint = land.depth / np.float32(focal)
    patches = sample(world.grain, land.x, land.y, 0.9)
    speckle = sample(world.terrain.detail, land.x, land.y, 0.035) * np.minimum(1, 0.05 / footprint)
    points = _Points(
        away=np.abs(land.lateral),
        arc=arc[row] + (arc[row + 1] - arc[row]) * fraction,
        village=world.road.table[row, Column.VILLAGE],
        footprint=footprint,
        patches=patches,
        speckle=speckle,
    )

    side = (land.lateral < 0).astype(np.int32)
    colour = _cover(points, look, world.road.biomes[row, side], side)
    if look.snow:
        bare = ramp(patches + 0.9 * speckle, 0.22, 0.5) * (0.35 + 0.4 * (points.away > 9))
        _mix(colour, (148, 136, 112), bare)
    colour *= (1 + (0.10 - 0.06 * look.snow) * patches + (0.30 - 0.2 * look.snow) * speckle)[..., None]
    _forest(world, land, look, patches, colour)
    mirror = np.where(land.water, np.float32(0.25 if look.snow else 0.75), np.float32(0))
    if land.water.any():
        _mix(colour, look.water, land.water * (1 - 0.25 * np.abs(patches)))

    if land.depth[-1].min() < 16:  # fine grain shows in the lowest rows only
        close = int(np.argmax(land.depth.min(axis=1) < 16))
        fine = sample(world.terrain.detail, land.y[close:], land.x[close:], 0.008)
        speckle[close:] += fine * np.minimum(1, 0.012 / footprint[close:])
    near = points.away < 7.5
    if near.any():
        colour[near], mirror[near] = _road(_Points(*(values[near] for values in points)), look, colour[near])
    colour *= _light(world, land, look, shadow)
    return colour, mirror


class _Points(NamedTuple):
    """Points of the land, one a pixel; all arrays have the same shape.

    Attributes:
        away: Distance from the middle of the road, in metres.
        arc: Length of the road up to there, in metres.
        village: 1 in a village, else 0, with soft edges.
        footprint: Metres of ground across the pixel.
        patches: Coarse noise.
        speckle: Fine noise.
    """

    away: Image
    arc: Image
    village: Image
    footprint: Image
    patches: Image
    speckle: Image


def _mix(colour: Real, other: Colour | Real, weight: Real) -> None:
    """Moves `colour` towards another by a weight in [0, 1] per pixel, in place."""
    share = weight[..., None].astype(np.float32)
    colour += (np.array(other, np.float32) - colour) * share


def _cover(points: _Points, look: Look, biome: NDArray[np.uint8], side: NDArray[np.int32]) -> Image:
    """Grass, fields and forest floor: the colour of the land away from the road, unlit."""
    away, arc = points.away, points.arc
    strip = np.floor((away + 20 * side) / 58).astype(np.int32)
    field = np.floor(arc / 83 + 0.37 * strip).astype(np.int32)
    draw = (field * 73856093 ^ strip * 19349663 ^ side * 83492791) >> 4
    palette = np.array([look.grass[0], look.grass[1], look.litter, *look.crops], np.float32)
    tilled = (biome == Biome.CROPS) | ((away > 75) & (draw % 3 > 0))
    wooded = np.isin(biome, WOODS) & (away < 260)
    index = np.select([away < 8.5, wooded & (away > 8.5), tilled], [1, 2, 3 + draw % len(look.crops)], 0)
    colour: Image = palette[index]
    blend = (0.5 + 0.9 * points.patches) * (index < 2)
    _mix(colour, look.grass[1], np.clip(blend, 0, 1))
    if not tilled.any():
        return colour
    furrow = np.where(draw % 2 == 0, away, arc) * np.float32(2 * np.pi / 1.6)
    depth = 0.13 * (tilled & (away > 8.5)) * np.minimum(1, 0.25 / points.footprint)
    colour *= (1 + depth * np.sin(furrow))[..., None]
    return colour


def _forest(world: World, land: Land, look: Look, patches: Image, colour: Image) -> None:
    """Closed forest on the near land, woods and bare rock on the mountains; in place."""
    away = np.abs(land.lateral)
    canopy = land.canopy > 1.5
    # The front of a forest is steep: its texture needs the height as well as the place.
    climb = land.canopy * land.crown * canopy
    grain = sample(world.grain, land.y + climb, land.x - 0.6 * climb, 0.35)
    if canopy.any():
        needles = np.array(look.needles, np.float32)
        leaves = np.array(look.foliage, np.float32).mean(axis=0) * 0.9
        share = ramp(patches[canopy], -0.15, 0.15)[:, None]
        crowns = needles * 1.15 + (leaves - needles * 1.15) * share
        crowns = crowns * (0.42 + 0.58 * land.crown[canopy] + 0.55 * grain[canopy])[:, None]
        if look.snow:
            dusted = np.clip(0.55 * land.crown[canopy] + 0.9 * grain[canopy], 0, 0.75)[:, None]
            crowns += (np.array((226, 230, 238), np.float32) - crowns) * dusted
        colour[canopy] = crowns
    mountain = ramp(away, 420, 1000) * ~canopy
    if mountain.any():
        rough = 0.5 * sample(world.grain, land.x, land.y, 9.0) + 0.35 * grain
        _mix(colour, look.far_wood, mountain * np.clip(0.85 + rough, 0, 1))


def _band(value: Real, half: float, footprint: Image) -> Image:
    """Share of a pixel that a strip of ±`half` metres around value 0 covers."""
    return np.asarray(np.clip((half - np.abs(value)) / footprint + 0.5, 0, 1) * np.minimum(1, 2 * half / footprint))


def _road(points: _Points, look: Look, colour: Image) -> tuple[Image, Image]:
    """Gravel, pavement, asphalt and its markings over the land's colour; returns colour and mirror."""
    away, arc, village, footprint, patches, speckle = points
    gravel = _band(away - 4.1, 0.75, footprint) * (1 - village)
    _mix(colour, _snowed((142, 130, 112), look, 0.85), gravel * np.clip(0.8 + speckle, 0, 1))
    pavement = _band(away - (_HALF_ROAD + _CURB) / 2, (_CURB - _HALF_ROAD) / 2, footprint) * village
    slabs = 1 - 0.18 * _band(np.mod(arc, 1.2) - 0.6, 0.05, footprint)
    _mix(colour, _snowed((168, 164, 158), look, 0.7), pavement)
    colour *= (1 - pavement * (1 - slabs))[:, None]
    _mix(colour, _snowed((196, 194, 190), look, 0.4), _band(away - 3.6, 0.12, footprint) * village)

    asphalt = _band(away, _HALF_ROAD, footprint)
    ruts = np.cos((away - 1.75) * 3.6)
    surface = np.array(look.road, np.float32) * (1 + 0.05 * patches + 0.14 * speckle + 0.04 * ruts)[:, None]
    dashes = _band(away, 0.07, footprint) * (np.mod(arc, 9.0) < 3.5)
    lines = np.maximum(_band(away - 3.2, 0.07, footprint), dashes)
    _mix(surface, (150, 152, 152) if look.wet else (216, 216, 210), lines * 0.9)
    if look.snow:
        tracks = np.exp(-(((np.abs(away - 1.75) - 0.72) / 0.27) ** 2))
        cover = np.clip(0.95 - 0.8 * tracks + 0.5 * patches + 0.2 * speckle, 0.08, 1)
        surface += (np.array((226, 230, 238), np.float32) - surface) * cover[:, None]
    colour += (surface - colour) * asphalt[:, None]
    if look.leaves == "turning":
        fallen = ramp(0.8 * speckle + 0.5 * patches + 0.12 * away, 0.6, 0.8)
        _mix(colour, (176, 106, 46), fallen * 0.75)
    puddles = 0.45 + 0.55 * ramp(patches + 0.15 * ruts, -0.05, 0.25)
    return colour, (look.wet * puddles * asphalt * 0.8).astype(np.float32)


def _snowed(colour: Colour, look: Look, cover: float) -> NDArray[np.float64]:
    return colour + (np.array((228, 232, 240)) - colour) * (look.snow * cover)


def _light(world: World, land: Land, look: Look, shadow: Image) -> Image:
    """Factor of light per pixel (or for all) and channel: shade everywhere, direct light by the slope to the sun."""
    shade, sun = np.array(look.shade_colour, np.float32), np.array(look.sun_colour, np.float32)
    if not look.sun:
        return shade
    ux, uy = look.sunward
    tangent = float(np.tan(look.sun_elevation))
    length = np.sqrt(1 + land.slope_x**2 + land.slope_y**2)
    facing = (tangent - land.slope_x * ux - land.slope_y * uy) / (length * tangent)
    facing[land.canopy > 1.5] = 0.8
    clouds = sample(world.grain, land.x + np.float32(TILE * look.cloud_offset[0]), land.y, 2.6)
    open_sky = ramp(clouds, look.clouds - 0.62, look.clouds - 0.42) if look.clouds < 0.75 else np.float32(1)
    direct = (
        look.sun * np.clip(facing, 0, 1.3) * (1 - shadow) * (0.35 + 0.65 * (1 - (1 - open_sky) * (land.depth > 60)))
    )
    return np.asarray(shade + (sun - shade) * direct[..., None], np.float32)
