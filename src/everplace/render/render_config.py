"""What a rendered route is made of: its conditions, its size and how exactly the drives repeat each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, field_validator

from everplace.errors import ConfigError, SettingError
from everplace.settings import Settings, first_problem

__all__ = ["CONDITIONS", "RenderConfig", "render_config"]

CONDITIONS: tuple[str, ...] = ("spring", "summer", "autumn", "winter", "night", "rain")
"""The conditions that can be rendered."""


class RenderConfig(Settings):
    """The whole configuration of a rendered route."""

    places: int = Field(default=200, ge=2, le=100_000)
    """Number of places along the route, one frame of every traverse each."""
    size: tuple[Annotated[int, Field(ge=16, le=480)], Annotated[int, Field(ge=16, le=640)]] = (64, 128)
    """Height and width of a frame in pixels, from 16 × 16 up to 480 × 640."""
    conditions: tuple[str, ...] = Field(default=CONDITIONS, min_length=1)
    """The traverses to render, each one drive; names out of `CONDITIONS`, in this order."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of the world and of the drives."""
    spacing: float = Field(default=12.0, ge=1.0, le=200.0, allow_inf_nan=False)
    """Metres from a place to the next, along the road."""
    lateral_std: float = Field(default=0.4, ge=0.0, le=1.5, allow_inf_nan=False)
    """Standard deviation of a drive's offset across the road, in metres."""
    longitudinal_std: float = Field(default=0.4, ge=0.0, le=5.0, allow_inf_nan=False)
    """Standard deviation of a drive's offset along the road, in metres."""
    heading_std: float = Field(default=2.0, ge=0.0, le=10.0, allow_inf_nan=False)
    """Standard deviation of a drive's offset in heading, in degrees."""
    format: Literal["png", "jpg"] = "png"
    """`png` (lossless) or `jpg`."""
    quality: int = Field(default=92, ge=1, le=100)
    """JPEG quality, 1 to 100; of no effect for `png`."""

    @field_validator("conditions")
    @classmethod
    def _known_and_distinct(cls, conditions: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in conditions if name not in CONDITIONS]
        if unknown:
            raise ValueError(f"{unknown[0]!r} is not one of {', '.join(CONDITIONS)}")
        if len(set(conditions)) != len(conditions):
            raise ValueError("a condition is named twice")
        return conditions


def render_config(values: Mapping[str, Any]) -> RenderConfig:
    """Makes a `RenderConfig` from options or a TOML table.

    Args:
        values: Field names and values; fields left out take their defaults.

    Raises:
        ConfigError: A field is unknown or its value out of range; the message names the first such field.
    """
    try:
        return RenderConfig(**values)
    except ValidationError as error:
        problem = first_problem(error, RenderConfig)
        option = problem.setting.partition(".")[0]  # an item of a list is told by the list
        if problem.known is not None:
            raise ConfigError(f"render has no option {option!r}; choose from {', '.join(problem.known)}") from error
        raise SettingError(option, f"{values.get(option)!r} cannot be: {problem.reason}; correct it") from error
