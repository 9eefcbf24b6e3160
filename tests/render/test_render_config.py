from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from everplace.errors import ConfigError
from everplace.render.render_config import CONDITIONS, RenderConfig, render_config


def test_defaults_render_all_six_conditions() -> None:
    config = render_config({})
    assert config == RenderConfig()
    assert config.conditions == CONDITIONS == ("spring", "summer", "autumn", "winter", "night", "rain")
    assert config.size == (64, 128)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"size": (15, 64)}, "size"),
        ({"size": (64, 15)}, "size"),
        ({"size": (481, 640)}, "size"),
        ({"size": (480, 641)}, "size"),
        ({"places": 1}, "places"),
        ({"seed": -1}, "seed"),
        ({"spacing": 0.0}, "spacing"),
        ({"spacing": float("nan")}, "spacing"),
        ({"lateral_std": -0.1}, "lateral_std"),
        ({"conditions": ()}, "conditions"),
        ({"conditions": ("summer", "monsoon")}, "conditions"),
        ({"conditions": ("summer", "summer")}, "conditions"),
        ({"format": "gif"}, "format"),
        ({"quality": 0}, "quality"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_bad_value_is_refused_by_the_name_of_its_field(values: dict[str, Any], field: str) -> None:
    with pytest.raises(ConfigError, match=field) as caught:
        render_config(values)
    assert "\n" not in str(caught.value)


def test_limits_themselves_are_allowed() -> None:
    assert render_config({"size": (16, 16)}).size == (16, 16)
    assert render_config({"size": (480, 640)}).size == (480, 640)


def test_configuration_cannot_change() -> None:
    with pytest.raises(ValidationError):
        RenderConfig().seed = 3
