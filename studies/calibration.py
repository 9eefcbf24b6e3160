"""Fits the provisional calibration of maps of one drive on rendered worlds, and says how well it holds elsewhere.

    python -m studies calibration --data DIR

Each condition of a world is the map in turn, adapted with the shipped prior, and all others are its queries. The check
is on the first places of Nordland and Gardens Point, where DIR holds them; nothing is fitted to these.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.prior import shipped_prior
from everplace.adaptation.route_adaptation import adapted_projection
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber
from everplace.mapping.calibration import ON_MAP, Calibration, best_place, fit_calibration, hidden, place_posterior
from everplace.mapping.reliability import brier_score, expected_calibration_error, with_interval
from everplace.mapping.route_learning import drive_statistics, light_moments
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, select

_METHOD = "hog16"
_SEEDS = (21, 22)  # the prior knows 11 to 13
_PLACES = 400
_DIMENSIONS = 96
_CHECKS = (
    ("nordland64", Selection(slice(0, 1000), drop_dark=True, drop_stationary=True), "summer", 1),
    ("gardens_point", Selection(slice(0, 70)), "day_right", 3),
)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies calibration", description=__doc__)
    parser.add_argument("--data", type=Path, help="directory of nordland64 and gardens_point (default: no check)")
    parser.add_argument(
        "--worlds", type=Path, help="directory to keep the rendered worlds in (default: a temporary one)"
    )
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        fitted = provisional(given.worlds or Path(temporary))
    print(json.dumps(fitted.to_dict(), indent=1))
    if given.data is not None:
        for line in checked(given.data, fitted):
            print(line)


def provisional(worlds: Path) -> Calibration:
    scores: list[NDArray[np.float32]] = []
    for seed in _SEEDS:
        world = worlds / f"world{seed}"
        if not world.is_dir():
            render_route(world, render_config({"places": _PLACES, "size": (64, 128), "seed": seed}))
        route = open_route(world)
        described = _described(route)
        for drive in route.traverses:
            scores += one_drive_scores(route, drive.name, described).values()
    places = np.tile(np.arange(_PLACES), len(scores))
    return fit_calibration(np.concatenate(scores), places, reach=1, provisional=True)


def _described(route: Route) -> dict[str, NDArray[np.float32]]:
    describer = open_describer(_METHOD)
    return {drive.name: describer.describe(drive).values for drive in route.traverses}


def one_drive_scores(
    route: Route, map_drive: str, described: dict[str, NDArray[np.float32]]
) -> dict[str, NDArray[np.float32]]:
    """The scores of every other drive, by its name, against a map of one drive."""
    describer = open_describer(_METHOD)
    statistics = drive_statistics(described[map_drive], light_moments(describer, route[map_drive]))
    prior = shipped_prior(describer.method, describer.settings())
    adapted = AdaptedDescriber(describer, adapted_projection(statistics, _DIMENSIONS, prior), {})
    values = {name: _unit(adapted.project(features)) for name, features in described.items()}
    database = values.pop(map_drive)
    return {name: queries @ database.T for name, queries in values.items()}


def checked(data: Path, calibration: Calibration) -> Iterator[str]:
    yield "| route | query | frames | right | error | Brier | right, fitted to the other half | error | Brier |"
    yield "|---" * 9 + "|"
    for name, selection, map_drive, reach in _CHECKS:
        route = select(open_route(data / name), selection)
        for query, scores in one_drive_scores(route, map_drive, _described(route)).items():
            half = np.arange(len(scores)) // 24 % 2 == 1
            own = fit_calibration(scores[~half], np.flatnonzero(~half), reach)
            before, after = _measured(scores, calibration, reach), _measured(scores, own, reach, half)
            yield f"| {name} | {query} | {len(scores)} | {before} | {after} |"


def _measured(
    scores: NDArray[np.float32], calibration: Calibration, reach: int, rows: NDArray[np.bool_] | None = None
) -> str:
    """Cells: the share of right answers, the calibration error and the Brier score, on the map and off it."""
    true = np.arange(len(scores))
    chosen = true if rows is None else np.flatnonzero(rows)
    probability, right = np.empty((len(chosen), 2)), np.zeros((len(chosen), 2), bool)
    for column, shown in enumerate((scores[chosen], hidden(scores[chosen], chosen, reach))):
        place, probability[:, column] = best_place(place_posterior(shown, calibration)[0], reach)
        right[:, column] = (np.abs(place - chosen) <= reach) & (column == 0)
    weights = np.broadcast_to(np.array([ON_MAP, 1 - ON_MAP]), right.shape)
    error = with_interval(expected_calibration_error, probability, right, weights)
    return (
        f"{right[:, 0].mean():.3f} | {error.value:.3f} ({error.interval[0]:.3f} to {error.interval[1]:.3f}) | "
        f"{brier_score(probability, right, weights):.3f}"
    )


def _unit(values: NDArray[np.float32]) -> NDArray[np.float32]:
    unit: NDArray[np.float32] = values / np.linalg.norm(values, axis=1, keepdims=True)
    return unit
