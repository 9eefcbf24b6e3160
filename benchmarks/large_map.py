"""A frame's scores at all places of a map of 300,000 frames, by a graph and by comparing it with every frame."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.made_map import MadeMap
from benchmarks.ratio import Ratio
from everplace.mapping.calibration import PROVISIONAL, place_posterior
from everplace.mapping.frame_graph import FrameGraph
from everplace.mapping.place_scores import PlaceFrames
from everplace.mapping.place_search import PlaceSearch

PLACES, DRIVES, QUERIES, BEST = 75_000, 4, 200, 10


def measure(scratch: Path) -> list[Ratio]:  # noqa: ARG001
    made = MadeMap(PLACES, DRIVES)
    vectors = made.vectors
    order = PlaceFrames(np.tile(np.arange(PLACES), DRIVES), np.tile(np.arange(PLACES, dtype=float), DRIVES))
    start = time.perf_counter()
    graph = FrameGraph.build(vectors)
    built = time.perf_counter() - start
    searches = PlaceSearch(vectors, order), PlaceSearch(vectors, order, graph)
    seconds: tuple[list[float], list[float]] = ([], [])
    recall, off = [], []
    for vector in made.queries(QUERIES):
        found = []
        for search, spent in zip(searches, seconds, strict=True):
            start = time.perf_counter()
            found.append(search.scores(vector).places)
            spent.append(time.perf_counter() - start)
        best = np.argsort(-found[0])[:BEST]
        recall.append(np.isclose(found[1][best], found[0][best], atol=1e-6).mean())
        (_, exact_off), (_, graph_off) = (place_posterior(scores, PROVISIONAL) for scores in found)
        off.append(abs(float(exact_off - graph_off)))
    exact, quick = (1000 * float(np.median(spent)) for spent in seconds)
    frames = f"{len(vectors):,} frames"
    return [
        Ratio(
            f"a frame's scores on a map of {frames}, by a graph",
            f"{quick:.2f} ms (built in {built:.0f} s)",
            f"{exact:.2f} ms for the exact search",
            quick / exact,
            at_most=0.8,
        ),
        Ratio(
            f"of the {BEST} best places of {frames}",
            f"{np.mean(recall):.4f} found",
            f"the exact search; P(off the map) differs by {np.mean(off):.4f}, at most {max(off):.3f}",
            float(np.mean(recall)),
            at_least=0.99,
        ),
    ]
