"""All methods side by side: time a frame, bytes a descriptor, time a query in a large map, memory.

The weights of AlexNet, VGG19, Table 1 and `best` are random: time and memory do not depend on them. A query is compared
with every frame of the map, exactly; of maps that would take more than 1 GB the time is measured on as many frames as
fit, and scaled.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.table import Table
from torch import nn

from everplace.describe.costs import peak_memory, time_describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.methods.alexnet import alexnet_features
from everplace.describe.methods.vgg19 import vgg19_features
from everplace.describe.registry import open_describer
from everplace.mapping.route_learning import adapt
from everplace.match.similarity import top_k
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route
from everplace.training.config import write_config
from everplace.training.fitted_methods import build_config, train

PLACES = 160
MAPS = (10_000, 100_000)
_MAP_BYTES = 1e9
_FEW, _MANY = 1, 65
_ROUNDS = 3


@dataclass(frozen=True)
class MethodCosts:
    """What one method costs.

    Attributes:
        method: Its name, and what about it is random.
        frame_ms: Median time of one decoded frame, alone.
        descriptor_bytes: As float32.
        query_ms: Time to compare one query with maps of 10⁴ and 10⁵ frames.
        scaled: Of each of these whether it is scaled from a smaller map.
        peak_mb: Largest memory of a process that describes with it, 10⁶ bytes.
    """

    method: str
    frame_ms: float
    descriptor_bytes: int
    query_ms: tuple[float, ...]
    scaled: tuple[bool, ...]
    peak_mb: float | None

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def measure(scratch: Path) -> list[MethodCosts]:
    world = {"places": PLACES, "size": (128, 256), "conditions": ("summer", "winter"), "format": "jpg"}
    render_route(scratch / "route", render_config(world))
    route = open_route(scratch / "route")
    paths = route["summer"].paths
    rows = []
    for name, method in _methods(scratch, route):
        describer = open_describer(method)
        frame = time_describer(describer, paths)
        described = describer.describe(route["summer"])
        took = [_query_ms(described, frames) for frames in MAPS]
        times, scaled = tuple(ms for ms, _ in took), tuple(whether for _, whether in took)
        rows.append(MethodCosts(name, frame.ms, 4 * describer.dimension, times, scaled, peak_memory(method, paths)))
    return rows


def table_of(rows: list[MethodCosts]) -> Table:
    queries = [f"ms/query of {frames:,}" for frames in MAPS]
    table = Table("method", "ms/frame", "bytes", *queries, "peak MB", f"MB of {MAPS[-1]:,}")
    for row in rows:
        times = [f"{'≈ ' if scaled else ''}{ms:.3g}" for ms, scaled in zip(row.query_ms, row.scaled, strict=True)]
        peak = "—" if row.peak_mb is None else f"{row.peak_mb:.0f}"
        size = f"{row.descriptor_bytes * MAPS[-1] / 1e6:.0f}"
        table.add_row(row.method, f"{row.frame_ms:.2f}", str(row.descriptor_bytes), *times, peak, size)
    return table


def _methods(scratch: Path, route: Route) -> Iterator[tuple[str, str]]:
    """What a row is called, and how the method is opened."""
    yield "SAD", "sad"
    yield "HOG", "hog"
    train(route, "fabmap", scratch / "fabmap")
    yield "FAB-MAP", str(scratch / "fabmap")
    for name, features in (("alexnet", alexnet_features), ("vgg19", vgg19_features)):
        torch.save(nn.ModuleDict({"features": features()}).state_dict(), scratch / f"{name}.pth")
    yield "AlexNet conv3, projected (random)", f"alexnet:{scratch / 'alexnet.pth'}"
    yield "VGG19 pool4 (random)", f"vgg19:pool4:{scratch / 'vgg19.pth'}"
    yield "EfficientNet-Lite0", "efficientnet"
    models: dict[str, dict[str, Any]] = {
        "Table 1, c-vae (random)": {"kind": "c-vae"},
        "best (random)": {
            "kind": "cp-vae",
            "places": 100,
            "fully_connected": False,
            "oriented_gradients": True,
        },
    }
    for number, (name, config) in enumerate(models.items()):
        model = ConditionVAE(ModelConfig.model_validate({"conditions": ("summer", "winter"), **config})).eval()
        run = scratch / f"model{number}"
        save_checkpoint(run, model, {})
        write_config(run, build_config(model=config["kind"]))
        yield name, str(run)
    yield "hog16", "hog16"
    for method in ("hog16", "hog16+efficientnet"):
        adapt(method, route, scratch / f"adapted-{method}")
        yield f"{method}, adapted", str(scratch / f"adapted-{method}")


def _query_ms(described: Descriptors, frames: int) -> tuple[float, bool]:
    """Milliseconds that one more query takes, and whether that is scaled from a smaller map."""
    fit = min(frames, int(_MAP_BYTES / (4 * described.dimension)))
    rows = np.arange(fit) % len(described)
    noise = np.random.default_rng(0).uniform(0.9, 1.1, (fit, 1)).astype(np.float32)  # so that no two are equal
    values = described.values[rows] * noise if described.metric != "place-posterior" else described.values[rows]
    database = replace(described, values=values, names=tuple(map(str, range(fit))), image_names=None)
    seconds = [
        min(_seconds(described.take(slice(queries)), database) for _ in range(_ROUNDS)) for queries in (_FEW, _MANY)
    ]
    return 1000 * (seconds[1] - seconds[0]) / (_MANY - _FEW) * frames / fit, fit < frames


def _seconds(query: Descriptors, database: Descriptors) -> float:
    start = time.perf_counter()
    top_k(query, database, 1)
    return time.perf_counter() - start
