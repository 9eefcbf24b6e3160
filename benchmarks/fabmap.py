"""FAB-MAP on a whole traverse, from words to posterior, against the one matrix product that it cannot do without."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.ratio import Ratio
from everplace.describe.files.descriptors import Descriptors
from everplace.fabmap.chow_liu import WordCounts, learn_tree
from everplace.fabmap.fabmap_model import FabMap, FabMapConfig
from everplace.match.similarity import similarity

FRAMES = 6400
BLOCK = 256
ROUNDS = 2


def measure(scratch: Path) -> list[Ratio]:  # noqa: ARG001 - nothing is written
    rng = np.random.default_rng(0)
    config = FabMapConfig()
    frequency = rng.uniform(0.01, 0.2, config.words)
    words = rng.random((FRAMES, config.words)) < frequency
    counts = WordCounts.none(config.words)
    start = time.perf_counter()
    for first in range(0, FRAMES, BLOCK):
        counts.add(words[first : first + BLOCK])
    tree = learn_tree(counts)
    learning = time.perf_counter() - start
    model = FabMap(config, np.zeros((config.words, 128), np.float32), tree, np.zeros((0, config.words), np.bool_))
    names = tuple(map(str, range(FRAMES)))
    whole, bare = [], []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        values = np.concatenate([model.embed(words[first : first + BLOCK]) for first in range(0, FRAMES, BLOCK)])
        described = Descriptors(values, names, "fabmap", "place-posterior")
        similarity(described, described)
        whole.append(time.perf_counter() - start)
        places, coefficients = values[:, : config.words], values[:, config.words : 2 * config.words]
        start = time.perf_counter()
        np.matmul(coefficients, places.T)
        bare.append(time.perf_counter() - start)
    taken, product = float(np.median(whole)), float(np.median(bare))
    return [
        Ratio(
            f"FAB-MAP, {FRAMES} × {FRAMES} frames, {config.words} words",
            f"{taken:.1f} s from words to posterior (tree: {learning:.1f} s)",
            f"{product:.1f} s for the matrix product alone",
            product / taken,
            at_least=0.2,
        )
    ]
