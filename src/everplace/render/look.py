"""What a condition looks like: light, air, sky, colours of the ground and of the leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

__all__ = ["LOOKS", "Colour", "Look", "look_of_drive"]

Colour = tuple[float, float, float]
"""Red, green, blue, each 0 to 255, as seen in full light."""

Leaves = Literal["young", "full", "turning", "bare"]


@dataclass(frozen=True, slots=True)
class Look:
    """The appearance of one condition, or of one drive under it.

    Attributes:
        sun_azimuth: Direction to the sun, radians counter-clockwise from the x axis.
        sun_elevation: Radians above the horizon.
        sun: Strength of the direct light, 0 (overcast) to 1; sharp shadows fall where it is above 0.
        sun_colour: Factor on the colour of sunlit surfaces, per channel.
        shade_colour: Factor on the colour of shaded surfaces, per channel.
        zenith: Colour of the sky overhead.
        horizon: Colour of the sky at the horizon, and of the haze.
        clouds: Share of the sky that is covered, 0 to 1.
        cloud_bright: Colour of the clouds' lit parts.
        cloud_dark: Colour of the clouds' thick parts.
        cloud_offset: Where in the endless cloud pattern this drive begins, in cloud tiles.
        haze: Depth in metres at which haze takes 63 % of the contrast.
        snow: Cover of snow, 0 to 1.
        wet: Wetness of road and roofs, 0 to 1.
        dark: Whether only headlights, lamps and windows light the scene.
        leaves: State of broadleaved trees.
        grass: Colours between which meadows vary.
        crops: Colours of the fields; each field keeps its place in this list under all conditions.
        litter: Colour of a woodland's floor.
        needles: Colour of conifers.
        foliage: Colours of broadleaved crowns, one a variant.
        reeds: Colour of bushes and reeds.
        water: Colour of deep water.
        far_wood: Colour of wooded mountains.
        road: Colour of the asphalt.
        exposure: Factor on the whole image.
        warmth: Factor on red, and its inverse on blue.
        noise: Standard deviation of the sensor's noise, in grey levels of 255.
        rain: Whether it rains.
    """

    sun_azimuth: float = 0.9
    sun_elevation: float = 0.8
    sun: float = 0.8
    sun_colour: Colour = (1.08, 1.04, 0.96)
    shade_colour: Colour = (0.52, 0.58, 0.70)
    zenith: Colour = (70, 125, 205)
    horizon: Colour = (190, 212, 232)
    clouds: float = 0.35
    cloud_bright: Colour = (250, 250, 250)
    cloud_dark: Colour = (185, 190, 202)
    cloud_offset: tuple[float, float] = (0.0, 0.0)
    haze: float = 2600.0
    snow: float = 0.0
    wet: float = 0.0
    dark: bool = False
    leaves: Leaves = "full"
    grass: tuple[Colour, Colour] = ((104, 124, 48), (82, 112, 44))
    crops: tuple[Colour, ...] = (
        (208, 178, 98),
        (96, 128, 52),
        (192, 170, 104),
        (74, 108, 42),
        (150, 140, 72),
    )
    litter: Colour = (84, 82, 48)
    needles: Colour = (34, 62, 36)
    foliage: tuple[Colour, ...] = ((58, 96, 34), (72, 108, 40), (50, 86, 38), (84, 112, 44))
    reeds: Colour = (78, 102, 42)
    water: Colour = (44, 74, 92)
    far_wood: Colour = (58, 84, 50)
    road: Colour = (112, 112, 114)
    exposure: float = 1.0
    warmth: float = 1.0
    noise: float = 2.0
    rain: bool = False


LOOKS: dict[str, Look] = {
    "spring": Look(
        sun_azimuth=2.2,
        sun_elevation=0.75,
        sun=0.75,
        zenith=(84, 146, 222),
        horizon=(204, 222, 236),
        clouds=0.5,
        haze=2200,
        leaves="young",
        grass=((118, 164, 62), (142, 174, 66)),
        crops=((128, 168, 72), (222, 204, 52), (126, 98, 70), (104, 152, 62), (140, 112, 80)),
        litter=(112, 106, 62),
        needles=(44, 76, 42),
        foliage=((138, 172, 74), (156, 184, 86), (120, 160, 64), (168, 178, 92)),
        reeds=(132, 152, 72),
        water=(70, 110, 138),
        far_wood=(86, 116, 66),
        road=(124, 124, 126),
    ),
    "summer": Look(),
    "autumn": Look(
        sun_azimuth=-1.0,
        sun_elevation=0.3,
        sun=0.85,
        sun_colour=(1.2, 1.02, 0.76),
        shade_colour=(0.5, 0.52, 0.62),
        zenith=(118, 156, 202),
        horizon=(236, 218, 190),
        clouds=0.25,
        cloud_bright=(255, 240, 214),
        cloud_dark=(196, 184, 184),
        haze=1100,
        leaves="turning",
        grass=((146, 130, 66), (120, 116, 60)),
        crops=((112, 84, 62), (184, 158, 106), (126, 126, 66), (104, 80, 60), (96, 74, 58)),
        litter=(172, 104, 48),
        needles=(40, 60, 38),
        foliage=((206, 132, 36), (190, 84, 36), (214, 172, 56), (146, 116, 48)),
        reeds=(166, 124, 62),
        water=(72, 86, 98),
        far_wood=(140, 100, 54),
        road=(108, 104, 100),
        warmth=1.05,
    ),
    "winter": Look(
        sun_azimuth=-0.5,
        sun_elevation=0.22,
        sun=0.35,
        sun_colour=(1.04, 1.0, 0.95),
        shade_colour=(0.78, 0.82, 0.88),
        zenith=(150, 164, 184),
        horizon=(206, 212, 220),
        clouds=0.85,
        cloud_bright=(208, 212, 220),
        cloud_dark=(162, 170, 184),
        haze=520,
        snow=1.0,
        leaves="bare",
        grass=((230, 234, 242), (216, 222, 234)),
        crops=((226, 230, 238), (206, 206, 208), (232, 236, 243), (196, 192, 190), (214, 216, 222)),
        litter=(204, 206, 212),
        needles=(34, 48, 42),
        foliage=((92, 80, 72), (84, 74, 68), (100, 88, 78), (88, 80, 74)),
        reeds=(150, 134, 112),
        water=(206, 214, 222),
        far_wood=(122, 128, 134),
        road=(150, 152, 158),
        warmth=0.97,
        noise=2.5,
    ),
    "night": Look(
        sun_elevation=0.3,
        sun=0.0,
        shade_colour=(0.9, 0.9, 0.9),
        zenith=(14, 19, 38),
        horizon=(40, 44, 60),
        clouds=0.3,
        cloud_bright=(34, 35, 42),
        cloud_dark=(14, 16, 24),
        haze=900,
        dark=True,
        noise=6.0,
        warmth=1.08,
    ),
    "rain": Look(
        sun=0.0,
        shade_colour=(0.66, 0.70, 0.74),
        zenith=(126, 132, 140),
        horizon=(178, 182, 186),
        clouds=1.0,
        cloud_bright=(172, 176, 180),
        cloud_dark=(108, 114, 122),
        haze=260,
        wet=1.0,
        grass=((96, 118, 56), (84, 104, 50)),
        crops=((160, 142, 84), (88, 118, 54), (146, 130, 84), (74, 104, 48), (116, 96, 66)),
        water=(96, 106, 114),
        road=(70, 72, 76),
        exposure=0.9,
        warmth=0.96,
        noise=3.0,
        rain=True,
    ),
}
"""The look of each condition."""


def look_of_drive(condition: str, rng: np.random.Generator) -> Look:
    """Returns a condition's look as it was on one drive: its own sun, clouds, exposure and white balance."""
    look = LOOKS[condition]
    return replace(
        look,
        sun_azimuth=look.sun_azimuth + float(rng.uniform(-0.3, 0.3)),
        sun_elevation=look.sun_elevation * float(rng.uniform(0.9, 1.1)),
        clouds=float(np.clip(look.clouds + rng.uniform(-0.1, 0.1), 0.05, 1.0)),
        cloud_offset=(float(rng.uniform(0, 64)), float(rng.uniform(0, 64))),
        exposure=look.exposure * float(rng.uniform(0.94, 1.06)),
        warmth=look.warmth * float(rng.uniform(0.98, 1.02)),
    )
