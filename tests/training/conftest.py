"""A route small enough to be trained on within a test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.route.route import Route, open_route
from everplace.training.config import TrainConfig

PLACES = 12

MakeConfig = Callable[..., TrainConfig]


@pytest.fixture(scope="session")
def route_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`day` and `night` at 12 places of 32×32; by night the same landscape is darker."""
    rng = np.random.default_rng(3)
    root = tmp_path_factory.mktemp("route") / "small"
    for condition in ("day", "night"):
        (root / condition).mkdir(parents=True)
    for place in range(PLACES):
        coarse = Image.fromarray(rng.integers(60, 256, (4, 4, 3), dtype=np.uint8))
        day = np.asarray(coarse.resize((32, 32), Image.Resampling.BICUBIC))
        Image.fromarray(day).save(root / "day" / f"{place}.png")
        Image.fromarray((day * 0.4).astype(np.uint8)).save(root / "night" / f"{place}.png")
    return root


@pytest.fixture(scope="session")
def route(route_path: Path) -> Route:
    """The small route: 8 training places, a gap of 2 and 2 held out, as `make_config` divides it."""
    return open_route(route_path)


@pytest.fixture(scope="session")
def make_config() -> MakeConfig:
    """Makes a configuration that fits the small route: two steps an epoch, unless told otherwise a small network."""

    def make(**values: Any) -> TrainConfig:
        given = {"model": "cp-vae", "image_size": (32, 32), "held_out_gap": 2, "batch_size": 8}
        given |= {"fully_connected": False, **values}
        if "epochs" not in given and "minutes" not in given:
            given["epochs"] = 2
        return TrainConfig.build(**given)

    return make
