"""Describing on a Ray cluster against describing in one process: processor time a frame.

The cluster is this machine alone, so the ratio says what handing over costs; what further machines add is not measured.
Images a second are shown beside it and not judged: on a busy machine they say who got more of it, and Ray has more
processes. The frames are rendered once and linked under many names, and each is decoded anew.

It counts from row `WARM` on, when all workers are at work, and all processes of Ray. A block or two of 256 frames then
wait, described already, so Ray's figures are too good by up to an eighth.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from benchmarks.ratio import Ratio
from everplace.choices import Engine
from everplace.describe.on_cluster import open_with
from everplace.progress import quiet
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.folder import open_traverse
from everplace.route.traverse import Traverse

PLACES, FRAMES = 40, 5120
WARM = 1024
ROUNDS = 2
ENGINES: tuple[Engine, ...] = ("local", "ray")


@dataclass(frozen=True)
class _Turn:
    first_row: float  # seconds
    per_second: float  # images
    processor: float  # ms a frame


def measure(scratch: Path) -> list[Ratio]:
    config = {"places": PLACES, "size": (480, 640), "conditions": ("summer",), "format": "jpg"}
    render_route(scratch / "route", render_config(config))
    rendered = sorted((scratch / "route" / "summer").iterdir())
    (scratch / "drive").mkdir()
    for number in range(FRAMES):
        os.link(rendered[number % PLACES], scratch / "drive" / f"{number:05d}.jpg")
    drive = open_traverse(scratch / "drive")
    turns: dict[Engine, list[_Turn]] = {engine: [] for engine in ENGINES}
    try:
        for _ in range(ROUNDS):  # by turns, so that a busy machine slows both
            for engine in ENGINES:
                turns[engine].append(_turn(engine, drive))
    finally:
        import ray  # not before `everplace.cluster` has said that no usage statistics are sent

        ray.shutdown()
    processor = {engine: float(np.median([turn.processor for turn in of])) for engine, of in turns.items()}
    return [
        Ratio(
            f"describing {FRAMES} JPEGs of 640×480, hog16, Ray on this machine",
            _figures(processor["ray"], turns["ray"]),
            _figures(processor["local"], turns["local"]),
            processor["ray"] / processor["local"],
            at_most=1.25,
        )
    ]


def _turn(engine: Engine, drive: Traverse) -> _Turn:
    begun = time.perf_counter()
    rows = open_with(engine, "hog16", quiet).describe_passing(drive).rows
    next(rows)
    first = time.perf_counter()
    for _ in range(WARM - 1):
        next(rows)
    warm, spent = time.perf_counter(), _processor_seconds()
    count = sum(1 for _ in rows)
    ended, after = time.perf_counter(), _processor_seconds()
    processor = sum(seconds - spent.get(process, 0.0) for process, seconds in after.items())
    return _Turn(first - begun, count / (ended - warm), 1000 * processor / count)


def _processor_seconds() -> dict[int, float]:
    """Of this process and all that it started."""
    spent = {}
    here = psutil.Process()
    for process in (here, *here.children(recursive=True)):
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        spent[process.pid] = times.user + times.system
    return spent


def _figures(processor: float, turns: list[_Turn]) -> str:
    rates = sorted(turn.per_second for turn in turns)
    waited = max(turn.first_row for turn in turns)
    rate = f"{rates[0]:.0f} to {rates[-1]:.0f} images/s"
    return f"{processor:.2f} ms of processor, {rate}, first row within {waited:.1f} s"
