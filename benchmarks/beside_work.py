"""Describing and training beside other work on every core, against the same alone: how much slower it gets.

With a busy process a core, fair shares are halves; what waits awake, as OpenMP's threads do by default, loses more.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.ratio import Ratio
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.threads import usable_cores, wait_briefly

ROUNDS = 3
WANTED = 3.0
"""Twice as long is fair."""
SIZE = (32, 64)


def measure(scratch: Path) -> list[Ratio]:
    route = scratch / "route"
    render_route(route, render_config({"places": 160, "size": SIZE, "conditions": ("summer", "winter")}))
    alone: dict[str, list[float]] = {}
    beside: dict[str, list[float]] = {}
    for number in range(ROUNDS):  # by turns, since the machine may be busy anyway
        for times, around in ((alone, contextlib.nullcontext()), (beside, _busy_cores())):
            with around:
                for what, seconds in _in_own_process(route, scratch / f"run{number}-{times is beside}").items():
                    times.setdefault(what, []).append(seconds)
    rows = []
    for what in alone:
        quiet, busy = (1000 * float(np.median(times[what])) for times in (alone, beside))
        other = f"{quiet:.2f} ms without it"
        rows.append(Ratio(f"{what}, beside other work", f"{busy:.2f} ms", other, busy / quiet, at_most=WANTED))
    return rows


@contextlib.contextmanager
def _busy_cores() -> Iterator[None]:
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(usable_cores())]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def _in_own_process(route: Path, run: Path) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.beside_work", str(route), str(run)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    seconds: dict[str, float] = json.loads(output.splitlines()[-1])
    return seconds


def _times(route: Path, run: Path) -> dict[str, float]:
    """Seconds of each kind of work, medians where it is short."""
    import torch

    from everplace.adaptation.oriented_gradients import OrientedGradients
    from everplace.describe.runs.trained import TrainedDescriber
    from everplace.model.checkpoint import Checkpoint
    from everplace.model.condition_vae import ConditionVAE
    from everplace.model.model_config import ModelConfig
    from everplace.route.route import open_route
    from everplace.training.config import TrainConfig
    from everplace.training.fit import train

    gradients = OrientedGradients(224, 224)
    best = ModelConfig(kind="cp-vae", conditions=("a", "b"), places=100, fully_connected=False, oriented_gradients=True)
    describer = TrainedDescriber(Checkpoint(ConditionVAE(best).eval()))
    pixels = np.random.default_rng(0).integers(0, 256, (32, 224, 224, 3), dtype=np.uint8)
    images = torch.rand(32, 3, 224, 224)
    times = {}
    for batch in (1, 32):
        times[f"oriented gradients of {batch} × 224×224"] = _median(partial(gradients, images[:batch]))
        times[f"best, describing {batch} × 224×224"] = _median(partial(describer.describe_batch, pixels[:batch]))
    config = TrainConfig.build(model="cp-vae", recipe="best", image_size=SIZE, grey=True, epochs=1)
    start = time.perf_counter()
    train(open_route(route), config, run)
    times["best, an epoch of 64×32"] = time.perf_counter() - start
    return times


def _median(work: Callable[[], object]) -> float:
    seconds = []
    for _ in range(40):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds[5:]))


if __name__ == "__main__":
    wait_briefly()  # as the command does
    print(json.dumps(_times(Path(sys.argv[1]), Path(sys.argv[2]))))
