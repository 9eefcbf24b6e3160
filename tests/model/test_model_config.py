"""What a model may be built as."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from everplace.model.model_config import ModelConfig


def test_defaults_are_the_papers() -> None:
    config = ModelConfig(kind="vae")
    assert (config.height, config.width, config.channels) == (224, 224, 3)
    assert (config.place_dimensions, config.condition_dimensions, config.latent_dimensions) == (96, 32, 128)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "vae", "height": 48, "width": 100}, "48x100 is not a multiple of 32 .* 64x96"),
        ({"kind": "vae", "height": 5, "width": 32}, "the nearest one is 32x32"),
        ({"kind": "vae", "height": 0}, "greater than 0"),
        ({"kind": "vae", "channels": 2}, "1 or 3"),
        ({"kind": "c-vae", "conditions": ("summer",)}, "c-vae needs at least two conditions"),
        ({"kind": "cp-vae", "conditions": ("a", "b"), "places": 1}, "cp-vae needs at least two places"),
        ({"kind": "d-vae"}, "'vae', 'c-vae', 'cp-vae' or 'cae'"),
        ({"kind": "vae", "latent": 4}, "Extra inputs"),
    ],
)
def test_what_cannot_be_built_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ModelConfig.model_validate(values)


def test_round_trip_through_json() -> None:
    config = ModelConfig(kind="cp-vae", height=32, width=64, channels=1, conditions=("a", "b"), places=7)
    assert ModelConfig.model_validate_json(config.model_dump_json()) == config
