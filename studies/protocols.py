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
        variants: What is trained, by its name in the table: values of `TrainConfig`.
        baselines: Methods that are measured beside it.
    """

    route: str
    conditions: tuple[str, ...]
    pairs: tuple[tuple[str, str], ...]
    train_frames: str
    test_frames: str
    tolerance: int
    filtered: bool
    settings: dict[str, Any] = field(default_factory=dict)
    variants: dict[str, dict[str, Any]] = field(default_factory=lambda: MODELS)
    baselines: tuple[str, ...] = ("sad", "hog")


MODELS: dict[str, dict[str, Any]] = {
    "cp-vae, best": {"model": "cp-vae", "recipe": "best"},
    "cp-vae": {"model": "cp-vae"},
    "cp-vae, all weights 1": {"model": "cp-vae", "weights": {"condition": 1.0, "place": 1.0}},
    "c-vae": {"model": "c-vae"},
    "vae": {"model": "vae"},
}
"""Models of the tables; of the recipe `faithful` unless they are called best."""

_FAITHFUL: dict[str, Any] = {"model": "cp-vae"}
# As it was when the rows were made; today the recipe has a tenth of the image term.
_BEST: dict[str, Any] = {"model": "cp-vae", "recipe": "best", "weights": {"image": 1.0}}
_TENTH: dict[str, Any] = {"model": "cp-vae", "recipe": "best"}
_LEARNED: dict[str, Any] = {"model": "cp-vae", "fully_connected": False, "fully_connected_rate": 1.0}


def _projection(**changed: float) -> dict[str, Any]:
    return {**_BEST, "projection": changed}


INGREDIENTS: dict[str, dict[str, Any]] = {
    "best": _BEST,
    "best, all of z_p learned": _LEARNED,
    "best, projection left as it starts": _projection(rate=0.0),
    "best, projection at the full rate": _projection(rate=1.0),
    "best, stretches and light not counted": _projection(stretches=0.0, light=0.0),
    "best, stretches not counted": _projection(stretches=0.0),
    "best, light not counted": _projection(light=0.0),
    "best, ridge 0.5": _projection(ridge=0.5),
    "best, ridge 8": _projection(ridge=8.0),
    "best, place target softened over neighbours": {**_BEST, "place_spread": 1.0},
    "best, Table 1's chain": {**_BEST, "fully_connected": True, "fully_connected_rate": 0.1},
    "best, a tenth of the image term": _TENTH,
    "best, batch 128": {**_BEST, "batch_size": 128},
    "best, no shift and no crop": {**_BEST, "augmentation": {"shift": 0.0, "crop": 0.0}},
    "best, no change of brightness and contrast": {**_BEST, "augmentation": {"brightness": 0.0, "contrast": 0.0}},
    "best, blur of up to a pixel": {**_BEST, "augmentation": {"blur": 1.0}},
    "best, 16 epochs": {**_BEST, "epochs": 16},
    "best, 16 epochs, a tenth of the image term": {**_TENTH, "epochs": 16},
    "faithful": _FAITHFUL,
    "faithful, position regressed instead of classes": {**_FAITHFUL, "place_term": "position"},
    "faithful, chain at the full learning rate": {**_FAITHFUL, "fully_connected_rate": 1.0},
    "faithful, place target softened over neighbours": {**_FAITHFUL, "place_spread": 1.0},
}
"""What the recipes are made of: each row changes one thing, and is compared on places that no table is tested on.

The ledger holds more rows, of what is gone from the code.
"""

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
    "ingredients": Protocol(
        route="nordland64",
        conditions=("summer", "winter"),
        pairs=(("winter", "summer"), ("summer", "winter")),
        train_frames="0:1200",
        test_frames="1220:1600",
        tolerance=1,
        filtered=True,
        settings={"image_size": (32, 64), "grey": True, "epochs": 8},
        variants=INGREDIENTS,
        baselines=("hog",),
    ),
}
