"""What each study trains on, tests on and counts as right."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Protocol:
    """One data set with its split.

    Attributes:
        route: Directory of the route, relative to the data directory.
        conditions: Traverses to train on; the tested pairs are among them.
        pairs: (query, database) traverses.
        train_frames: Places to train on.
        test_frames: Places to test on.
        tolerance: Places by which a match may be off.
        filtered: Whether dark and stationary places are dropped.
        settings: Further values of `TrainConfig`, the same for all models.
    """

    route: str
    conditions: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    train_frames: str
    test_frames: str
    tolerance: int
    filtered: bool
    settings: dict[str, Any] = field(default_factory=dict)


PROTOCOLS = {
    "nordland64": Protocol(
        route="nordland64",
        conditions=("summer", "winter"),
        pairs=(("winter", "summer"), ("summer", "winter")),
        train_frames="0:1600",
        test_frames="1620:",
        tolerance=1,
        filtered=True,
        settings={"image_size": (32, 64), "grey": True, "epochs": 16},
    ),
    "gardens_point": Protocol(
        route="gardens_point",
        conditions=("day_right", "night_right"),
        pairs=(("night_right", "day_right"), ("day_right", "night_right")),
        train_frames="0:100",
        test_frames="100:140",
        tolerance=3,
        filtered=False,
        settings={"image_size": (64, 128), "grey": True, "epochs": 60, "tolerance": 3},
    ),
}

VARIANTS: dict[str, dict[str, Any]] = {
    "cp-vae, best": {"model": "cp-vae", "recipe": "best", "epochs": 32},
    "cp-vae": {"model": "cp-vae"},
    "cp-vae, all weights 1": {"model": "cp-vae", "weights": {"condition": 1.0, "place": 1.0}},
    "c-vae": {"model": "c-vae"},
    "vae": {"model": "vae"},
}
"""Models of the tables; of the recipe `faithful` unless they are called best."""

BASELINES = ("sad", "hog")
