"""Peak memory of training and describing with ten times the frames; pages of packed images are not counted."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import psutil

from benchmarks.ratio import Ratio
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

FEW, MANY = 120, 1200


def measure(scratch: Path) -> list[Ratio]:
    routes = {}
    for places in (FEW, MANY):
        routes[places] = scratch / f"route{places}"
        config = {"places": places, "size": (64, 64), "conditions": ("summer", "winter")}
        render_route(routes[places], render_config(config))
    rows = []
    for what in ("train", "describe"):
        few, many = (_peak(what, routes[places], scratch / f"{what}{places}") for places in (FEW, MANY))
        rows.append(
            Ratio(
                f"memory to {what}, {MANY // FEW}× the frames",
                f"{many / 2**20:.0f} MiB with {MANY} places",
                f"{few / 2**20:.0f} MiB with {FEW} places",
                many / few,
                at_most=1.2,
            )
        )
    return rows


def _peak(what: str, route: Path, out: Path) -> int:
    """Peak resident memory, in bytes, of a process that does the work; mapped files left out."""
    environment = {**os.environ, "EVERPLACE_CACHE": str(out.with_suffix(".cache"))}
    train = ["train", str(route), "--model", "cp-vae", "--image-size", "64", "64", "--epochs", "2", "--out", str(out)]
    run = out.with_name(out.name.replace("describe", "train"))
    describe = ["describe", str(run), str(route / "summer"), "--out", str(out.with_suffix(".h5"))]
    command = [sys.executable, "-m", "everplace.cli.main", *(train if what == "train" else describe)]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak, ended = 0, threading.Event()
    watched = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            memory = watched.memory_info()
            peak = max(peak, memory.rss - memory.shared)
        except psutil.NoSuchProcess:
            break
        ended.wait(0.02)
    if process.wait() != 0:
        raise RuntimeError(f"{' '.join(command)} failed")
    return peak
