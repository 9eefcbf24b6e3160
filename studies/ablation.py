"""What each part of adapting is worth: ridge, other light, the changes of whole stretches, and the weight of the prior.

    python -m studies ablation --data DATA --out OUT

Nordland's places 0-999 alone: summer is the map, winter 0-499 teaches (matched once, as `adapt --self-taught` does),
and winter 520-999 is tested, ±1. OUT/table.md holds recall@1 / auc_pr with `hog16` and 96 numbers.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation import route_adaptation
from everplace.adaptation.moments import Moments
from everplace.adaptation.prior import Prior, shipped_prior
from everplace.adaptation.route_adaptation import taught_projection
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.registry import open_describer
from everplace.files import write_text
from everplace.mapping.route_learning import Learning, drive_statistics, light_moments
from everplace.match.similarity import similarity
from everplace.route.route import open_route
from everplace.route.selection import Selection, select
from everplace.scoring.scores import evaluate

__all__ = ["VARIANTS", "rows", "with_stretches"]

_PLACES, _TAUGHT, _TESTED = 1000, 500, 520
_STRETCH = 24

VARIANTS: Mapping[str, Mapping[str, float]] = {
    "as it is": {},
    "ridge 1/4": {"RIDGE": 0.25},
    "ridge 4": {"RIDGE": 4.0},
    "no other light": {"LIGHT_WEIGHT": 0.0},
    "other light, weight 2": {"LIGHT_WEIGHT": 2.0},
    "stretches, weight 2": {"stretches": 2.0},
    "stretches, weight 20": {"stretches": 20.0},
    "prior counts as 50 pairs": {"PRIOR_WEIGHT": 50.0},
    "prior counts as 800 pairs": {"PRIOR_WEIGHT": 800.0},
}
"""Rows: what `route_adaptation` takes for granted, otherwise; and what the mean of a stretch weighs, for each pair."""


def with_stretches(
    changes: NDArray[np.float32], weights: NDArray[np.float64], weight: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Changes and weights with those of whole stretches of 24 pairs behind them.

    Args:
        changes: K×F, in the order of travel.
        weights: (K,).
        weight: What the mean of a stretch counts, in weights of its pairs.
    """
    whole = len(changes) // _STRETCH * _STRETCH
    means = changes[:whole].reshape(-1, _STRETCH, changes.shape[1]).mean(axis=1)
    sums = weights[:whole].reshape(-1, _STRETCH).sum(axis=1)
    return np.concatenate([changes, means]), np.concatenate([weights, weight * sums])


def rows(
    features: tuple[NDArray[np.float32], NDArray[np.float32]],
    light: Moments,
    prior: Prior | None,
    dimensions: int,
    taught: int = _TAUGHT,
    tested: int = _TESTED,
    variants: Mapping[str, Mapping[str, float]] = VARIANTS,
) -> Iterator[tuple[str, list[str]]]:
    """Scores of every variant.

    Args:
        features: N×F of the map and of a later drive, row for row the same places.
        light: See `light_moments`, of the map.
        prior: Scatter within places on other routes.
        dimensions: D.
        taught: Places of the later drive before this one teach.
        tested: Places from this one on are tested.
        variants: See `VARIANTS`.

    Yields:
        The variant, and recall@1 / auc_pr from one drive without and with the prior, and self-taught without and with.
    """
    map_drive, later = features
    base = drive_statistics(map_drive, light)
    learning = Learning(base, _described(map_drive), [_described(later[:taught])], dimensions, None)
    pairs = learning.matched()
    changes, weights = learning.changes(pairs)
    for what, settings in variants.items():
        constants = {name: value for name, value in settings.items() if name != "stretches"}
        cells = []
        for count in (0, len(changes)):
            told = with_stretches(changes[:count], weights[:count], settings.get("stretches", 0.0))
            for known in (None, prior):
                if not count and known is None and constants.get("LIGHT_WEIGHT") == 0:
                    cells.append("")  # nothing tells how a place changes
                    continue
                with patch.dict(vars(route_adaptation), constants):
                    projection, _ = taught_projection(base, *told, dimensions, known)
                S = similarity(_described(projection.apply(later[tested:])), _described(projection.apply(map_drive)))
                truth = np.abs(np.arange(tested, len(later))[:, None] - np.arange(len(map_drive))) <= 1
                scores = evaluate(S, truth)
                cells.append(f"{scores.recall_at[1]:.3f}/{scores.auc_pr:.3f}")
        yield what, cells


def _described(values: NDArray[np.float32]) -> Descriptors:
    return Descriptors(values, tuple(map(str, range(len(values)))), "hog16")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies ablation", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="directory that holds nordland64")
    parser.add_argument("--out", type=Path, required=True, help="directory for table.md")
    parser.add_argument("--dimensions", type=int, default=96)
    given = parser.parse_args(arguments)
    selection = Selection(slice(0, _PLACES), drop_dark=True, drop_stationary=True)
    route = select(open_route(given.data / "nordland64"), selection)
    describer = open_describer("hog16")
    map_drive, later = (describer.describe(route[name]).values for name in ("summer", "winter"))
    light = light_moments(describer, route["summer"])
    prior = shipped_prior(describer.method, describer.settings())
    lines = list(_HEAD)
    for what, cells in rows((map_drive, later), light, prior, given.dimensions):
        lines.append(f"| {what} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    write_text(given.out / "table.md", "\n".join([*lines, ""]))


_HEAD = (
    "| variant | one drive, no prior | with the prior | self-taught, no prior | with the prior |",
    "|---|---|---|---|---|",
)
