"""Makes the prior that ships with the package: how places change, learnt from rendered worlds.

    python -m studies prior --out src/everplace/adaptation/priors/hog16.safetensors

Half of it is what differs between six conditions at one place, all pairs of them alike; half is what other light
changes in the frames of summer and autumn.
"""

from __future__ import annotations

import argparse
import tempfile
from itertools import combinations
from pathlib import Path

from everplace.adaptation.drive_statistics import half_differences
from everplace.adaptation.moments import Moments
from everplace.adaptation.prior import Prior, write_prior
from everplace.describe.registry import open_describer
from everplace.mapping.route_learning import light_moments
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route

_SEEDS = (11, 12, 13)
_PLACES = 400
_IN_LIGHT = ("summer", "autumn")


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies prior", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="file to write")
    parser.add_argument("--method", default="hog16")
    parser.add_argument(
        "--worlds", type=Path, help="directory to keep the rendered worlds in (default: a temporary one)"
    )
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        make_prior(given.method, given.out, given.worlds or Path(temporary))


def make_prior(method: str, out: Path, worlds: Path) -> None:
    describer = open_describer(method)
    pairs, light = (Moments.none(describer.dimension) for _ in range(2))
    for seed in _SEEDS:
        world = worlds / f"world{seed}"
        if not world.is_dir():
            render_route(world, render_config({"places": _PLACES, "size": (64, 128), "seed": seed}))
        route = open_route(world)
        described = [describer.describe(traverse).values for traverse in route.traverses]
        for first, second in combinations(described, 2):
            pairs += Moments.of(half_differences(first, second))
        for name in _IN_LIGHT:
            light += light_moments(describer, route[name])
    within = 0.5 * pairs.second_moment() + 0.5 * light.second_moment()
    write_prior(out, Prior.of(within, describer.method, describer.settings()))
