"""A step of the sequence filter, against comparing that frame's descriptor of 96 numbers with the whole database."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.ratio import Ratio
from everplace.sequences.route_filter import RouteFilter

ROUNDS = 30
NUMBERS = 96


def measure(scratch: Path) -> list[Ratio]:  # noqa: ARG001
    rows = []
    for places in (10_000, 100_000):
        rng = np.random.default_rng(0)
        values = rng.normal(size=(places, NUMBERS)).astype(np.float32)
        values /= np.linalg.norm(values, axis=1, keepdims=True)
        online = RouteFilter(places)
        stepping, product = [], []
        for place in range(ROUNDS):
            frame = values[place] + rng.normal(size=NUMBERS).astype(np.float32) / NUMBERS**0.5
            start = time.perf_counter()
            scores = values @ frame
            product.append(time.perf_counter() - start)
            start = time.perf_counter()
            online.update(scores)
            stepping.append(time.perf_counter() - start)
        step, multiply = 1000 * float(np.median(stepping)), 1000 * float(np.median(product))
        rows.append(
            Ratio(
                f"a frame through the filter, {places:,} places",
                f"{step:.2f} ms",
                f"{multiply:.2f} ms for the product with {NUMBERS} numbers a place",
                step / multiply,
                at_most=4.0,
            )
        )
    return rows
