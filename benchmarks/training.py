"""The training loop of the Table 1 network against a bare loop that feeds it from a tensor in memory.

And what it gains by keeping the memory that a step frees.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Literal, TypeAlias

import lightning
import numpy as np
import torch

from benchmarks.ratio import Ratio
from everplace.model.bounds import Weights, optimal_log_sigma
from everplace.model.condition_vae import ConditionVAE
from everplace.model.inference import default_device
from everplace.model.model_config import ModelConfig
from everplace.model.pixels import to_input
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import open_route
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch, EpochOrder, TrainingFrames, split_route
from everplace.training.freed_memory import freed_memory_kept
from everplace.training.module import BoundModule
from everplace.training.remedies import RemedyTerms
from everplace.training.terms import bound_terms
from everplace.training.trainer import GRADIENT_NORM, bf16_is_fast, make_loader, torch_settings_kept

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
    frames = TrainingFrames(split, config.augmentation, config.seed)
    order = EpochOrder(len(frames), BATCH, config.seed)
    model = ConditionVAE(ModelConfig(kind="cp-vae", conditions=split.conditions, places=split.places))
    kept = loop != "giving back" and DEVICE.type == "cpu"
    with freed_memory_kept() if kept else contextlib.nullcontext():
        if loop == "bare":
            stored = [frames[key] for key in order]
            ready = [Batch(*(part.to(DEVICE) for part in batch)) for batch in stored]
            return _bare_steps(model.to(DEVICE), config, [(to_input(batch.images), batch) for batch in ready])
        module = BoundModule(model, RemedyTerms(model.config, config.remedies), config, len(order))
        return _lightning_steps(module, frames, order)


class _Clock(lightning.Callback):
    """Notes the time between the ends of steps."""

    def __init__(self) -> None:
        self.steps: list[float] = []
        self._last = 0.0

    def on_train_batch_end(
        self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, *rest: object
    ) -> None:
        now = time.perf_counter()
        if self._last:
            self.steps.append(now - self._last)
        self._last = now


def _lightning_steps(module: BoundModule, frames: TrainingFrames, order: EpochOrder) -> list[float]:
    clock = _Clock()
    trainer = lightning.Trainer(
        accelerator="gpu" if DEVICE.type == "cuda" else "cpu",
        devices=1,
        max_steps=STEPS[DEVICE.type],
        precision="bf16-mixed" if bf16_is_fast(DEVICE.type) else "32-true",
        deterministic="warn" if DEVICE.type == "cuda" else False,
        gradient_clip_val=GRADIENT_NORM,
        callbacks=[clock],
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        use_distributed_sampler=False,
    )
    with torch_settings_kept():
        trainer.fit(module, make_loader(frames, order))
    return clock.steps[2:]


def _bare_steps(model: ConditionVAE, config: TrainConfig, stored: list[tuple[torch.Tensor, Batch]]) -> list[float]:
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, fused=True)
    weights = Weights(**config.weights.model_dump())
    times = []
    for index, (images, batch) in enumerate(_repeat(stored)):
        start = time.perf_counter()
        with torch.autocast(DEVICE.type, enabled=bf16_is_fast(DEVICE.type), dtype=torch.bfloat16):
            output = model(images, torch.randn(len(images), 128, device=DEVICE))
        labels = (batch.conditions, batch.places)
        log_sigma = optimal_log_sigma(images, output.reconstruction)
        terms = bound_terms(model, images, output, log_sigma, labels, weights)
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
