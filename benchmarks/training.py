"""The training loop of the Table 1 network against a bare loop that feeds it from a tensor in memory.

And what it gains by keeping the memory that a step frees.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import torch

from benchmarks.ratio import Ratio
from everplace.model.bounds import optimal_log_sigma
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import default_device
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route
from everplace.training.config import TrainConfig
from everplace.training.devices import bf16_is_fast, deterministic_training, launch
from everplace.training.display import Display
from everplace.training.frames import Batch, SplitRoute, TrainingFrames, split_route
from everplace.training.freed_memory import freed_memory_kept
from everplace.training.loop import GRADIENT_NORM, run_epochs
from everplace.training.resume_state import RunProgress
from everplace.training.run_keeper import RunKeeper
from everplace.training.schedule import make_optimizer
from everplace.training.step import bound_terms

Loop: TypeAlias = Literal["everplace", "giving back", "bare"]

SIZE = (224, 224)
BATCH = 64  # as the recipes have it
STEPS = {"cpu": 8, "cuda": 40}
ROUNDS = 3
DEVICE = default_device()


def measure(scratch: Path) -> list[Ratio]:
    os.environ["EVERPLACE_CACHE"] = str(scratch / "cache")
    route = scratch / "route"
    render_route(route, render_config({"places": 130, "size": SIZE, "conditions": ("summer", "winter")}))
    loops: tuple[Loop, ...] = ("everplace", "giving back", "bare") if DEVICE.type == "cpu" else ("everplace", "bare")
    times: dict[Loop, list[float]] = {loop: [] for loop in loops}
    for _ in range(ROUNDS):  # by turns, so that a busy machine slows all
        for loop in loops:
            # A heap that once kept its memory would go on keeping some.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
                times[loop] += pool.submit(_steps, loop, route).result()
    speeds = {loop: BATCH / float(np.median(steps)) for loop, steps in times.items()}
    what, ours = f"training, Table 1, batch {BATCH}, 224×224×3", speeds["everplace"]
    speed = f"{ours:.1f} images/s"
    against_bare = f"{speeds['bare']:.1f} images/s bare loop"
    rows = [Ratio(what, f"{speed} from packed images", against_bare, ours / speeds["bare"], at_least=0.9)]
    if "giving back" in speeds:
        without = speeds["giving back"]
        kept = f"{what}, freed memory kept"
        rows.append(Ratio(kept, speed, f"{without:.1f} images/s given back", ours / without, at_least=1.2))
    return rows


def _steps(loop: Loop, route: Path) -> list[float]:
    """Seconds of each step."""
    config = TrainConfig.build(model="cp-vae", image_size=SIZE, batch_size=BATCH, epochs=1000)
    split = split_route(open_route(route), config)
    frames = TrainingFrames(split, config.augmentation, BATCH, config.seed)
    model = ConditionVAE(ModelConfig(kind="cp-vae", conditions=split.conditions, places=split.places))
    kept = loop != "giving back" and DEVICE.type == "cpu"
    with freed_memory_kept() if kept else contextlib.nullcontext():
        if loop == "bare":
            stored = [frames.batch(0, positions) for positions in frames.order(0)]
            ready = [Batch(*(part.to(DEVICE) for part in batch)) for batch in stored]
            return _bare_steps(model.to(DEVICE), config, [(to_input(batch.images), batch) for batch in ready])
        return _loop_steps(model, config, split, frames, route.parent)


class _EnoughError(Exception):
    """So many steps were timed."""


class _Clock(Display):
    """Notes the time between the ends of steps."""

    def __init__(self) -> None:
        self.steps: list[float] = []
        self._last = 0.0

    def advance(self) -> None:
        now = time.perf_counter()
        if self._last:
            self.steps.append(now - self._last)
        self._last = now
        if len(self.steps) + 1 == STEPS[DEVICE.type]:
            raise _EnoughError


def _loop_steps(
    model: ConditionVAE, config: TrainConfig, split: SplitRoute, frames: TrainingFrames, scratch: Path
) -> list[float]:
    clock = _Clock()
    keeper = RunKeeper(scratch, config, split, "", [], RunProgress(), save_every=math.inf)
    with deterministic_training() if DEVICE.type == "cuda" else contextlib.nullcontext():
        fabric = launch(1, 1)
        optimizer = make_optimizer(model.to(fabric.device), config)
        with contextlib.suppress(_EnoughError):
            run_epochs(fabric, model, optimizer, frames, lambda _: {}, config, keeper, clock)
    return clock.steps[2:]


def _bare_steps(model: ConditionVAE, config: TrainConfig, stored: list[tuple[torch.Tensor, Batch]]) -> list[float]:
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, fused=True)
    times = []
    for index, (images, batch) in enumerate(_repeat(stored)):
        start = time.perf_counter()
        with torch.autocast(DEVICE.type, enabled=bf16_is_fast(DEVICE.type), dtype=torch.bfloat16):
            output = model(images, torch.randn(len(images), 128, device=DEVICE))
        log_sigma = optimal_log_sigma(images, output.reconstruction)
        terms = bound_terms(model, images, output, log_sigma, batch.conditions, batch.places, config.weights)
        loss = -terms["bound"].mean() / images[0].numel()
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(model.parameters(), GRADIENT_NORM)
        optimizer.step()
        if DEVICE.type == "cuda":
            torch.cuda.synchronize()
        times.append(time.perf_counter() - start)
        if index + 1 == STEPS[DEVICE.type]:
            break
    return times[3:]


def _repeat(stored: list[tuple[torch.Tensor, Batch]]) -> Iterator[tuple[torch.Tensor, Batch]]:
    while True:
        yield from stored
