"""Scores of whole archives: every frame of Nordland against every other, and absolute differences."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.spatial.distance import cdist

from benchmarks.ratio import Ratio
from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity

NORDLAND = 27_592
FRAMES = 1500
ROUNDS = 3

_ALL_SCORES = """
import json, sys, time
from pathlib import Path
import numpy as np
from everplace.describe.files.descriptors import Descriptors
from everplace.match.similarity import similarity_blocks

count = int(sys.argv[1])
rng = np.random.default_rng(0)
values = rng.standard_normal((count, 96), np.float32)
names = tuple(map(str, range(count)))
query, database = Descriptors(values, names, "m"), Descriptors(values[::-1].copy(), names, "m")
start = time.perf_counter()
for _rows, S in similarity_blocks(query, database):
    S.max(axis=1)
taken = time.perf_counter() - start
start = time.perf_counter()
for first in range(0, count, 1024):
    (query.values[first : first + 1024] @ database.values.T).max(axis=1)
bare = time.perf_counter() - start
status = Path("/proc/self/status").read_text()
peak = next(int(line.split()[1]) / 1000 for line in status.splitlines() if line.startswith("VmHWM:"))
print(json.dumps([taken, bare, peak]))
"""


def measure(scratch: Path) -> list[Ratio]:  # noqa: ARG001 - nothing is written
    done = subprocess.run(
        [sys.executable, "-c", _ALL_SCORES, str(NORDLAND)], capture_output=True, text=True, check=True
    )
    taken, bare, peak = json.loads(done.stdout)
    what = f"all {NORDLAND:,} × {NORDLAND:,} cosines, 96 numbers"
    return [
        Ratio(what, f"{taken:.1f} s", f"{bare:.1f} s for the products alone", bare / taken, at_least=0.5),
        Ratio(f"{what}: memory", f"{peak:.0f} MB", "1000 MB", peak / 1000, at_most=1.0),
        _absolute_differences(),
    ]


def _absolute_differences() -> Ratio:
    values = np.random.default_rng(0).standard_normal((FRAMES, 2048), np.float32)
    described = Descriptors(values, tuple(map(str, range(FRAMES))), "m", "mean-absolute-difference")
    ours, theirs = [], []
    for _ in range(ROUNDS):
        start = time.process_time()
        similarity(described, described)
        ours.append(time.process_time() - start)
        start = time.process_time()
        cdist(values[: FRAMES // 10], values, "cityblock")
        theirs.append(10 * (time.process_time() - start))
    taken, scipys = min(ours), min(theirs)
    pairs = (20_000 / FRAMES) ** 2
    return Ratio(
        f"SAD of {FRAMES} × {FRAMES} frames",
        f"{taken:.1f} s of processor time ({pairs * taken:.0f} s for 20,000 × 20,000)",
        f"{scipys:.1f} s by SciPy",
        scipys / taken,
        at_least=10.0,
    )
