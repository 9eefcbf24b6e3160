"""The colour of the land: road, verge, fields, forest, water, in a condition's light."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from everplace.render.look import Colour, Look
from everplace.render.noise import ramp, sample
from everplace.render.road import Biome, Column
from everplace.render.terrain import Land
from everplace.render.world import World

__all__ = ["Ground", "paint_ground"]

Image = NDArray[np.float32]
Real = NDArray[np.floating[Any]]

_HALF_ROAD = 3.5
_CURB = 5.6


class Ground(NamedTuple):
    """The painted land.

    Attributes:
        colour: rows × W × 3, RGB in 0 to 255, lit.
        mirror: rows × W, how much it reflects: 0 for dull ground to 1.
    """

    colour: Image
    mirror: Image


def paint_ground(world: World, land: Land, look: Look, shadow: Image, focal: float) -> Ground:
    """Paints the visible land.

    Args:
        world: Gives the road and the textures.
        land: The visible land, rows × W.
        look: The appearance.
        shadow: rows × W, share of the direct light that objects take away.
        focal: Focal length in pixels; fades textures too fine for a pixel.
    """
    row, fraction = world.road.rows(land.x)
    arc = world.road.table[:, Column.ARC]
    arc = arc[row] + (arc[row + 1] - arc[row]) * fraction
    village = world.road.table[row, Column.VILLAGE]
    away = np.abs(land.lateral)
    footprint = land.depth / np.float32(focal)  # metres of ground across one pixel
    patches = sample(world.grain, land.x, land.y, 0.9)
    speckle = sample(world.terrain.detail, land.x, land.y, 0.035) * np.minimum(1, 0.05 / footprint)

    colour = _cover(world, land, look, row, arc, away, patches, footprint)
    if look.snow:
        bare = ramp(patches + 0.9 * speckle, 0.22, 0.5) * (0.35 + 0.4 * (away > 9))
        _mix(colour, (148, 136, 112), bare)
    colour *= (1 + (0.10 - 0.06 * look.snow) * patches + (0.30 - 0.2 * look.snow) * speckle)[..., None]
    _forest(world, land, look, patches, colour)
    dull = np.zeros_like(away)
    mirror = np.where(land.water > 0, np.float32(0.25 if look.snow else 0.75), dull)
    if (land.water > 0).any():
        _mix(colour, look.water, land.water * (1 - 0.25 * np.abs(patches)))

    near = away < 7.5
    close = int(np.argmax(land.depth.min(axis=1) < 16))  # fine grain shows in the lowest rows only
    if land.depth[-1].min() < 16:
        fine = sample(world.terrain.detail, land.y[close:], land.x[close:], 0.008)
        speckle[close:] += fine * np.minimum(1, 0.012 / footprint[close:])
    if near.any():
        road_part = _Strip(*(values[near] for values in (land.lateral, arc, footprint, patches, speckle, village)))
        colour[near], mirror[near] = _road(road_part, look, colour[near])
    colour *= _light(world, land, look, shadow)
    return Ground(colour, mirror.astype(np.float32))


def _mix(colour: Real, other: Colour, weight: Real) -> None:
    """Moves `colour` towards another by a weight in [0, 1] per pixel, in place."""
    share = weight[..., None].astype(np.float32)
    colour += (np.array(other, np.float32) - colour) * share


def _cover(
    world: World,
    land: Land,
    look: Look,
    row: NDArray[np.int32],
    arc: Image,
    away: Image,
    patches: Image,
    footprint: Image,
) -> Image:
    """Grass, fields and forest floor: the colour of the land away from the road, unlit."""
    side = (land.lateral < 0).astype(np.int32)
    biome = world.road.biomes[row, side]
    strip = np.floor((away + 20 * side) / 58).astype(np.int32)
    field = np.floor(arc / 83 + 0.37 * strip).astype(np.int32)
    draw = (field * 73856093 ^ strip * 19349663 ^ side * 83492791) >> 4
    crops = len(look.crops)
    palette = np.array([look.grass[0], look.grass[1], look.litter, *look.crops], np.float32)
    tilled = (biome == Biome.CROPS) | ((away > 75) & (draw % 3 > 0))
    wooded = ((biome == Biome.CONIFERS) | (biome == Biome.WOODLAND)) & (away < 260)
    index = np.where(tilled, 3 + draw % crops, 0)
    index = np.where(wooded & (away > 8.5), 2, np.where((away < 8.5), 1, index))
    colour = palette[index]
    blend = (0.5 + 0.9 * patches) * (index < 2)
    _mix(colour, look.grass[1], np.clip(blend, 0, 1))
    if not tilled.any():
        return colour
    furrow = np.where(draw % 2 == 0, away, arc) * np.float32(2 * np.pi / 1.6)
    depth = 0.13 * (tilled & (away > 8.5)) * np.minimum(1, 0.25 / footprint)
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


class _Strip(NamedTuple):
    """Pixels on and beside the road, one-dimensional."""

    lateral: Image
    arc: Image
    footprint: Image
    patches: Image
    speckle: Image
    village: Image


def _band(value: Real, half: float, footprint: Image) -> Image:
    """Share of a pixel that a strip of ±`half` metres around value 0 covers."""
    return np.asarray(np.clip((half - np.abs(value)) / footprint + 0.5, 0, 1) * np.minimum(1, 2 * half / footprint))


def _road(strip: _Strip, look: Look, colour: Image) -> tuple[Image, Image]:
    """Gravel, pavement, asphalt and its markings over the land's colour; returns colour and mirror."""
    away = np.abs(strip.lateral)
    white = np.array((226, 230, 238), np.float32)
    colour = colour.copy()
    gravel = _band(away - 4.1, 0.75, strip.footprint) * (1 - strip.village)
    _mix(colour, _snowed((142, 130, 112), look, 0.85), gravel * np.clip(0.8 + strip.speckle, 0, 1))
    pavement = _band(away - (3.5 + _CURB) / 2, (_CURB - 3.5) / 2, strip.footprint) * strip.village
    slabs = 1 - 0.18 * _band(np.mod(strip.arc, 1.2) - 0.6, 0.05, strip.footprint)
    _mix(colour, _snowed((168, 164, 158), look, 0.7), pavement)
    colour *= (1 - pavement * (1 - slabs))[:, None]
    _mix(colour, _snowed((196, 194, 190), look, 0.4), _band(away - 3.6, 0.12, strip.footprint) * strip.village)

    asphalt = _band(away, _HALF_ROAD, strip.footprint)
    worn = 1 + 0.05 * strip.patches + 0.14 * strip.speckle + 0.04 * np.cos((away - 1.75) * 3.6)
    surface = np.array(look.road, np.float32) * worn[:, None]
    lines = np.maximum(
        _band(away - 3.2, 0.07, strip.footprint),
        _band(away, 0.07, strip.footprint) * (np.mod(strip.arc, 9.0) < 3.5),
    )
    _mix(surface, (216, 216, 210) if not look.wet else (150, 152, 152), lines * 0.9)
    if look.snow:
        tracks = np.exp(-(((np.abs(away - 1.75) - 0.72) / 0.27) ** 2))
        cover = np.clip(0.95 - 0.8 * tracks + 0.5 * strip.patches + 0.2 * strip.speckle, 0.08, 1)
        surface += (white - surface) * cover[:, None]
    colour += (surface - colour) * asphalt[:, None]
    if look.leaves == "turning":
        fallen = ramp(0.8 * strip.speckle + 0.5 * strip.patches + 0.12 * away, 0.6, 0.8)
        _mix(colour, (176, 106, 46), fallen * 0.75)
    puddles = 0.45 + 0.55 * ramp(strip.patches + 0.15 * np.cos((away - 1.75) * 3.6), -0.05, 0.25)
    mirror = look.wet * puddles * asphalt * 0.8
    return colour, mirror.astype(np.float32)


def _snowed(colour: Colour, look: Look, cover: float) -> Colour:
    share = look.snow * cover
    r, g, b = (c + (w - c) * share for c, w in zip(colour, (228, 232, 240), strict=True))
    return r, g, b


def _light(world: World, land: Land, look: Look, shadow: Image) -> Image:
    """Factor of light per pixel and channel: shade everywhere, direct light by the slope towards the sun."""
    shade, sun = np.array(look.shade_colour, np.float32), np.array(look.sun_colour, np.float32)
    if not look.sun:
        return np.broadcast_to(shade, (*land.depth.shape, 3))
    ux, uy = float(np.cos(look.sun_azimuth)), float(np.sin(look.sun_azimuth))
    tangent = float(np.tan(look.sun_elevation))
    length = np.sqrt(1 + land.slope_x**2 + land.slope_y**2)
    facing = (tangent - land.slope_x * ux - land.slope_y * uy) / (length * tangent)
    facing[land.canopy > 1.5] = 0.8
    drift = 512 * look.cloud_offset[0]
    clouds = sample(world.grain, land.x + np.float32(drift), land.y, 2.6)
    open_sky = ramp(clouds, look.clouds - 0.62, look.clouds - 0.42) if look.clouds < 0.75 else np.float32(1)
    direct = (
        look.sun * np.clip(facing, 0, 1.3) * (1 - shadow) * (0.35 + 0.65 * (1 - (1 - open_sky) * (land.depth > 60)))
    )
    return np.asarray(shade + (sun - shade) * direct[..., None], np.float32)
