"""Kinds of work by turns, so that a busy machine slows all."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import numpy as np


def by_turns(work: Mapping[str, Callable[[], object]], rounds: int, frames: int = 1, warm: int = 0) -> dict[str, float]:
    """Median seconds of each kind of work.

    Args:
        work: What is called, by its name.
        rounds: Turns of each.
        frames: Times that it is called and timed in a turn.
        warm: Times that it is called before, so that caches are as in a loop over frames.
    """
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        for name, do in work.items():
            for number in range(warm + frames):
                start = time.perf_counter()
                do()
                if number >= warm:
                    seconds[name].append(time.perf_counter() - start)
    return {name: float(np.median(taken)) for name, taken in seconds.items()}
