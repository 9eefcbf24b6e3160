"""One query against large maps: FAISS's exact search and the graph (HNSW), how many of the ten best it finds, how fast.

The map's descriptors are made as `benchmarks.made_map` says, four drives of each place. The graph is built as on a real
map. Of the efforts (efSearch), the least that finds 0.99 is chosen with half of the queries; it and the effort of a
localizer, who wants 256 frames and not ten, are measured with the other half. Queries come one by one, in one thread;
processor time tells what a busy machine adds to their p99.

Beside it what everplace does not use: 1,024 inverted lists of product-quantised frames (24 bytes, FAISS's fast scan),
of which the best thousand are compared anew in full. The least number of lists that finds 0.99 is chosen likewise.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import faiss
import numpy as np
from numpy.typing import NDArray

from benchmarks.made_map import MadeMap
from benchmarks.ratio import Ratio
from everplace.mapping.frame_graph import EFFORT, FrameGraph

SIZES = (10_000, 100_000)
DRIVES, QUERIES, EXACT_QUERIES, BEST = 4, 1000, 100, 10
LISTS = "IVF1024,PQ48x4fs,RFlat"
PROBES = (32, 64, 128, 256, 384, 512, 768)
ALL_LISTS = 1024
ANEW = 100
TRAINED = 100_000
EFFORTS = (32, 48, 64, 96, 128, 192, 256, 384, 512)
RECALL = 0.99
P99_MS = 1.0


def measure(scratch: Path, sizes: Sequence[int] = SIZES) -> list[Ratio]:
    return [row for frames in sizes for row in _of_size(frames, scratch)]


def _of_size(frames: int, scratch: Path) -> list[Ratio]:
    made = MadeMap(frames // DRIVES, DRIVES)
    exact = faiss.IndexFlatIP(made.vectors.shape[1])
    exact.add(made.vectors)
    queries = made.queries(QUERIES)
    _, best = exact.search(queries, BEST)
    exact_ms, _ = _each(lambda query: exact.search(query[None], BEST)[1][0], queries[:EXACT_QUERIES], best)
    start = time.perf_counter()
    graph = FrameGraph.kept(made.vectors, [scratch])
    built = time.perf_counter() - start
    kept = sum(path.stat().st_size for path in scratch.glob("*.hnsw"))
    asked, known = queries[QUERIES // 2 :], best[QUERIES // 2 :]

    def by(effort: int) -> Callable[[NDArray[np.float32]], NDArray[np.int64]]:
        return lambda query: graph.nearest(query, BEST, effort=effort)

    enough = (
        effort for effort in EFFORTS if _each(by(effort), queries[: QUERIES // 2], best[: QUERIES // 2])[1] >= RECALL
    )
    efforts = {next(enough, EFFORT): "the least", EFFORT: "a localizer's"}
    vectors = made.vectors.nbytes
    what = f"{frames:,} frames by a graph"
    rows = [
        Ratio(
            f"{what}: bytes",
            f"{kept / 1e6:.0f} MB, built and kept in {built:.0f} s",
            f"{vectors / 1e6:.0f} MB of numbers alone",
            kept / vectors,
            at_most=1.5,
        )
    ]
    for effort, kind in efforts.items():
        ms, recall = _each(by(effort), asked, known)
        named = f"{what}, efSearch {effort} ({kind})"
        rows += [
            *_found(named, recall, f"{recall:.4f} of the {BEST} best", ms, f"{P99_MS:.0f} ms; exact {_told(exact_ms)}"),
        ]
    return [*rows, *_by_lists(made.vectors, queries, best)]


def _by_lists(vectors: NDArray[np.float32], queries: NDArray[np.float32], best: NDArray[np.int64]) -> list[Ratio]:
    start = time.perf_counter()
    index = faiss.index_factory(vectors.shape[1], LISTS, faiss.METRIC_INNER_PRODUCT)
    faiss.extract_index_ivf(index).cp.min_points_per_centroid = 1  # else it warns of few frames
    index.train(vectors[:: max(1, len(vectors) // TRAINED)])
    index.add(vectors)
    built = time.perf_counter() - start
    half = QUERIES // 2

    def by(probes: int) -> Callable[[NDArray[np.float32]], NDArray[np.int64]]:
        lists = faiss.SearchParametersIVF(nprobe=probes)
        settings = faiss.IndexRefineSearchParameters(k_factor=ANEW, base_index_params=lists)
        return lambda query: index.search(query[None], BEST, params=settings)[1][0]

    enough = (probes for probes in PROBES if _each(by(probes), queries[:half], best[:half])[1] >= RECALL)
    probes = next(enough, ALL_LISTS)
    ms, recall = _each(by(probes), queries[half:], best[half:])
    named = f"{len(vectors):,} frames by {probes} of {ALL_LISTS} lists"
    return _found(named, recall, f"{recall:.4f} of the {BEST} best (built in {built:.0f} s)", ms, f"{P99_MS:.0f} ms")


def _found(named: str, recall: float, told: str, ms: NDArray[np.float64], against: str) -> list[Ratio]:
    """What a way of searching finds, and how fast."""
    return [
        Ratio(f"{named}: recall@{BEST}", told, "the exact search", recall, at_least=RECALL),
        Ratio(f"{named}: p99", _told(ms), against, float(np.percentile(ms[0], 99)) / P99_MS, at_most=1.0),
    ]


def _each(
    search: Callable[[NDArray[np.float32]], NDArray[np.int64]],
    queries: NDArray[np.float32],
    best: NDArray[np.int64],
) -> tuple[NDArray[np.float64], float]:
    """Milliseconds of every query, by the clock and of the processor, and the share of the best that is found."""
    ms, shares = np.empty((2, len(queries))), np.empty(len(queries))
    for number, query in enumerate(queries):
        start = np.array([time.perf_counter(), time.thread_time()])
        found = search(query)
        ms[:, number] = 1000 * (np.array([time.perf_counter(), time.thread_time()]) - start)
        shares[number] = np.isin(best[number], found).mean()
    return ms, float(shares.mean())


def _told(ms: NDArray[np.float64]) -> str:
    p99, of_processor = np.percentile(ms, 99, axis=1)
    return f"{p99:.2f} ms (median {np.median(ms[0]):.2f}; of processor time {of_processor:.2f})"
