"""What a condition looks like: light, air, sky, colours of the ground and of the leaves."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from importlib import resources
from typing import Literal

import numpy as np
from pydantic import TypeAdapter

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["LOOKS", "Colour", "Look", "look_of_drive"]

Colour = tuple[float, float, float]
"""Red, green, blue, each 0 to 255, as seen in full light."""


@dataclass(frozen=True, slots=True)
class Look:
    """The appearance of one condition, or of one drive under it.

    Attributes:
        sun_azimuth: Direction to the sun, radians counter-clockwise from the x axis.
        sun_elevation: Radians above the horizon.
        sun: Strength of the direct light, 0 (overcast) to 1; shadows fall from 0.2 on.
        sun_colour: Factor on the colour of sunlit surfaces, per channel.
        shade_colour: Factor on the colour of shaded surfaces, per channel.
        zenith: Colour of the sky overhead.
        horizon: Colour of the sky at the horizon, and of the haze.
        clouds: Share of the sky that is covered, 0 to 1.
        cloud_bright: Colour of the clouds' lit parts.
        cloud_dark: Colour of the clouds' thick parts.
        haze: Depth in metres at which haze takes 63 % of the contrast.
        snow: Cover of snow, 0 to 1.
        wet: Wetness of road and roofs, 0 to 1; where above 0, it rains.
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
        cloud_offset: Where in the endless cloud pattern a drive begins, in cloud tiles.
    """

    sun_azimuth: float
    sun_elevation: float
    sun: float
    sun_colour: Colour
    shade_colour: Colour
    zenith: Colour
    horizon: Colour
    clouds: float
    cloud_bright: Colour
    cloud_dark: Colour
    haze: float
    snow: float
    wet: float
    dark: bool
    leaves: Literal["young", "full", "turning", "bare"]
    grass: tuple[Colour, Colour]
    crops: tuple[Colour, ...]
    litter: Colour
    needles: Colour
    foliage: tuple[Colour, ...]
    reeds: Colour
    water: Colour
    far_wood: Colour
    road: Colour
    exposure: float
    warmth: float
    noise: float
    cloud_offset: tuple[float, float] = (0.0, 0.0)

    @property
    def sunward(self) -> tuple[float, float]:
        """Unit vector on the ground towards the sun."""
        return float(np.cos(self.sun_azimuth)), float(np.sin(self.sun_azimuth))


def _read_looks() -> dict[str, Look]:
    text = resources.files("everplace.render").joinpath("looks.toml").read_text(encoding="utf-8")
    tables = tomllib.loads(text)
    return TypeAdapter(dict[str, Look]).validate_python({name: tables["summer"] | tables[name] for name in tables})


LOOKS = _read_looks()
"""The look of each condition."""


def look_of_drive(condition: str, rng: np.random.Generator) -> Look:
    """Returns a condition's look as it was on one drive: its own sun, clouds, exposure and white balance."""
    look = LOOKS[condition]
    return replace(
        look,
        sun_azimuth=look.sun_azimuth + rng.uniform(-0.3, 0.3),
        sun_elevation=look.sun_elevation * rng.uniform(0.9, 1.1),
        clouds=float(np.clip(look.clouds + rng.uniform(-0.1, 0.1), 0.05, 1.0)),
        cloud_offset=(rng.uniform(0, 64), rng.uniform(0, 64)),
        exposure=look.exposure * rng.uniform(0.94, 1.06),
        warmth=look.warmth * rng.uniform(0.98, 1.02),
    )
