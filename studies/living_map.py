"""A map that lives: each further drive is localised on it before it is added, and the answers get better.

    python -m studies living_map --data DATA --out OUT

The rendered route: 600 places; the map begins with summer; autumn, rain, winter and night follow, each localised with a
detour of 50 frames of another world. Nordland (64×32, both filters): the map is summer; winter comes in halves.
OUT/table.md holds, drive by drive: recall@1, Brier score and calibration error frame by frame, what the filter finds at
a precision of 0.99, how well the detour is told, and frames a second.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.files import write_json, write_text
from everplace.images.decoding import ImageSpec, decode_images
from everplace.mapping.localizer import Localizer
from everplace.mapping.reliability import brier_score, expected_calibration_error
from everplace.mapping.route_map import Map
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route
from everplace.route.selection import Selection, select
from everplace.route.traverse import Traverse

_PLACES, _DETOUR, _AT = 600, 50, 300
_DRIVES = ("autumn", "rain", "winter", "night")
_PRECISION = 0.99


@dataclass(frozen=True)
class Answered:
    """What a map answered of a drive, frame by frame.

    Attributes:
        right: (M,) whether the place is the true one, ±1.
        probability: (M,) of the match.
        off: (M,) probability of being off the map.
        on: (M,) whether the frame is of the map's route.
        rate: Frames a second, decoding not counted.
    """

    right: NDArray[np.bool_]
    probability: NDArray[np.float64]
    off: NDArray[np.float64]
    on: NDArray[np.bool_]
    rate: float


def answered(map_: Map, drives: Sequence[tuple[Traverse, bool]], true: dict[str, int], sequence: int) -> Answered:
    """Localises the frames of parts of drives, in order; of each part, whether it is of the map's route."""
    localizer = Localizer(map_, sequence=sequence)
    right, probability, off, on = [], [], [], []
    spent = 0.0
    place = {stem: index for index, stem in enumerate(true)}
    for part, known in drives:
        for stem, image in zip(part.stems, decode_images(part.paths, ImageSpec()), strict=True):
            begun = time.perf_counter()
            answer = localizer.locate(image)
            spent += time.perf_counter() - begun
            found = place.get(answer.database_frame, -10)
            right.append(known and abs(found - place[stem]) <= 1)
            probability.append(answer.probability)
            off.append(answer.off_map)
            on.append(known)
    rate = len(on) / spent
    return Answered(np.array(right), np.array(probability), np.array(off), np.array(on), rate)


def figures(alone: Answered, filtered: Answered, threshold: float) -> dict[str, float]:
    """The columns of the table."""
    on = alone.on
    sure = filtered.probability >= threshold
    told = filtered.off > 0.5
    return {
        "threshold": threshold,
        "recall": float(alone.right[on].mean()),
        "brier": brier_score(alone.probability, alone.right),
        "calibration_error": expected_calibration_error(alone.probability, alone.right),
        "filter_recall": float(filtered.right[on].mean()),
        "sure_precision": float(filtered.right[sure].mean()) if sure.any() else float("nan"),
        "sure_recall": float((filtered.right & sure)[on].mean()),
        "filter_calibration_error": expected_calibration_error(filtered.probability, filtered.right),
        "detour_precision": float((~on & told).sum() / max(told.sum(), 1)),
        "detour_recall": float(told[~on].mean()) if (~on).any() else float("nan"),
        "frames_a_second": filtered.rate,
    }


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies living_map", description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--method", default="hog16")
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    rows = [*rendered(given.out, given.method), *nordland(given.data, given.out, given.method)]
    write_json(given.out / "rows.json", rows)
    names = list(rows[0])
    lines = ["| " + " | ".join(names) + " |", "|---" * len(names) + "|"]
    lines += ["| " + " | ".join(_cell(row[name]) for name in names) + " |" for row in rows]
    write_text(given.out / "table.md", "\n".join(lines) + "\n")


def rendered(out: Path, method: str) -> list[dict[str, object]]:
    worlds = []
    for seed, places in ((21, _PLACES), (22, _DETOUR)):
        world = out / f"world{seed}"
        if not world.is_dir():
            render_route(world, render_config({"places": places, "size": (64, 128), "seed": seed}))
        worlds.append(open_route(world))
    route, other = worlds
    map_ = Map.create(out / f"map-{method}", route["summer"], method=method)
    true = {stem: index for index, stem in enumerate(route["summer"].stems)}
    rows = []
    for name in _DRIVES:
        drive = route[name]
        parts = [(drive[:_AT], True), (other[name], False), (drive[_AT:], True)]

        def measured(parts: Sequence[tuple[Traverse, bool]] = parts) -> dict[str, float]:
            return figures(answered(map_, parts, true, 1), answered(map_, parts, true, 10), _threshold(map_))

        rows.append(_row("rendered", name, "before", measured()))
        map_.add(drive)
        rows.append(_row("rendered", name, "after", measured()))
    return rows


def nordland(data: Path, out: Path, method: str) -> list[dict[str, object]]:
    route = select(open_route(data / "nordland64"), Selection(None, drop_dark=True, drop_stationary=True))
    winter, summer = route["winter"], route["summer"]
    map_ = Map.create(out / f"nordland-{method}", summer, method=method)
    true = {stem: index for index, stem in enumerate(summer.stems)}
    parts = [(winter[1020:], True)]
    rows = []
    for when in ("before", "after"):
        if when == "after":
            map_.add(winter[:1000], name="winter, first half", condition="winter", align="images")
        rows.append(
            _row(
                "nordland",
                "winter, second half",
                when,
                figures(answered(map_, parts, true, 1), answered(map_, parts, true, 10), _threshold(map_)),
            )
        )
    return rows


def _threshold(map_: Map) -> float:
    return Localizer(map_).threshold(_PRECISION)


def _row(set_: str, drive: str, when: str, found: dict[str, float]) -> dict[str, object]:
    row = {"set": set_, "drive": drive, "map": when, **found}
    print(json.dumps(row), flush=True)
    return row


def _cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
