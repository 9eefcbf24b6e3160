"""All methods side by side: time a frame, bytes a descriptor, time a query in a large map, memory.

The weights of AlexNet, VGG19, Table 1 and `best` are random, and so are FAB-MAP's words: time and memory do not depend
on them. Nor do they on the maps' descriptors, which are random numbers of the right size. A query is one of 33, which
are compared with every frame of the map, exactly; of maps that would take more than 100 MB the time is measured on as
many frames as fit, and scaled. Of a frame's time it is the median over 16 frames, of memory the largest while 32 are
described.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.table import Table
from torch import nn

from everplace.describe.costs import peak_memory, time_describer
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.methods.alexnet import alexnet_features
from everplace.describe.methods.vgg19 import vgg19_features
from everplace.describe.registry import open_describer
from everplace.describe.runs.fabmap import FabMapDescriber
from everplace.fabmap.chow_liu import WordCounts, learn_tree
from everplace.fabmap.fabmap_model import FabMap, FabMapConfig, save_fabmap
from everplace.fabmap.vocabulary import FEATURE_DIMENSIONS
from everplace.mapping.route_learning import adapt
from everplace.match.similarity import top_k
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route
from everplace.route.route import Route, open_route
from everplace.training.config import write_config
from everplace.training.fitted_methods import build_config

PLACES = 100
MAPS = (10_000, 100_000)
_MAP_BYTES = 100e6
_QUERIES = 33
_ROUNDS = 2
_TIMED, _DESCRIBED = 16, 32
_SEEN = 0.05
"""Share of the words that a frame of FAB-MAP's random map shows."""


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
        frame = time_describer(describer, paths, frames=_TIMED)
        fit = [min(frames, int(_MAP_BYTES / (4 * describer.dimension))) for frames in MAPS]
        measured = {frames: _query_ms(describer, frames) for frames in set(fit)}
        times = tuple(measured[some] * frames / some for some, frames in zip(fit, MAPS, strict=True))
        scaled = tuple(some < frames for some, frames in zip(fit, MAPS, strict=True))
        memory = peak_memory(method, paths, frames=_DESCRIBED)
        rows.append(MethodCosts(name, frame.ms, 4 * describer.dimension, times, scaled, memory))
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
    _save_random_fabmap(scratch / "fabmap")
    yield "FAB-MAP (random words)", str(scratch / "fabmap")
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
    adapt("hog16", route.choose(["summer"]), scratch / "adapted")
    yield "hog16, adapted", str(scratch / "adapted")


def _save_random_fabmap(run: Path) -> None:
    rng = np.random.default_rng(0)
    config = FabMapConfig()
    counts = WordCounts.none(config.words)
    counts.add(rng.random((512, config.words)) < _SEEN)
    vocabulary = rng.random((config.words, FEATURE_DIMENSIONS), np.float32)
    save_fabmap(run, FabMap(config, vocabulary, learn_tree(counts), np.zeros((0, config.words), np.bool_)))
    write_config(run, build_config(model="fabmap"))


def _query_ms(describer: Describer, frames: int) -> float:
    """Milliseconds that one more query takes in a map of so many frames."""
    database, queries = _random(describer, frames, seed=0), _random(describer, _QUERIES, seed=1)
    one, all_of_them = (
        min(_seconds(queries.take(slice(count)), database) for _ in range(_ROUNDS)) for count in (1, _QUERIES)
    )
    return 1000 * (all_of_them - one) / (_QUERIES - 1)


def _random(describer: Describer, frames: int, seed: int) -> Descriptors:
    """Descriptors of the method's size that are not of any image."""
    rng = np.random.default_rng(seed)
    if isinstance(describer, FabMapDescriber):
        values = describer.model.embed(rng.random((frames, describer.model.config.words), np.float32) < _SEEN)
    else:
        values = rng.standard_normal((frames, describer.dimension), np.float32)
    return Descriptors(values, tuple(map(str, range(frames))), describer.method, describer.metric)


def _seconds(query: Descriptors, database: Descriptors) -> float:
    start = time.perf_counter()
    top_k(query, database, 1)
    return time.perf_counter() - start
