"""Opening a route of a million frames, against listing and sorting the same directories; no image is opened."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from benchmarks.ratio import Ratio

FRAMES = 1_000_000
ROUNDS = 2

_OPEN = "from everplace.route.route import open_route; work = lambda: open_route(sys.argv[1])"
_BARE = """
def work():
    with os.scandir(sys.argv[1]) as entries:
        directories = sorted(entry.path for entry in entries)
    listed = []
    for directory in directories:
        with os.scandir(directory) as entries:
            listed.append(sorted(entry.name for entry in entries))
    return listed
"""
_MEASURE = """
start = time.perf_counter()
result = work()
seconds = time.perf_counter() - start
# Not ru_maxrss, which begins with what the parent held.
with open("/proc/self/status") as status:
    peak = next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmHWM:"))
print(json.dumps([seconds, peak]))
"""


def measure(scratch: Path) -> list[Ratio]:
    rows = []
    for traverses in (1, 4):
        route = scratch / f"route{traverses}"
        for number in range(traverses):
            _fill(route / f"drive{number}", FRAMES // traverses)
        opened, bare = [], []
        for _ in range(ROUNDS):  # by turns, so that a busy machine slows both
            opened.append(_run(_OPEN, route))
            bare.append(_run(_BARE, route))
        seconds, memory = (min(values) for values in zip(*opened, strict=True))
        bare_seconds = min(bare)[0]
        what = f"a route of {traverses} × {FRAMES // traverses} frames"
        rows += [
            Ratio(
                f"opening {what}",
                f"{seconds:.1f} s",
                f"{bare_seconds:.1f} s to list and sort",
                seconds / bare_seconds,
                at_most=3.0,
            ),
            Ratio(
                f"memory to open {what}",
                f"{memory / 2**20:.0f} MiB",
                "the limit of 500 MB",
                memory / 500e6,
                at_most=1.0,
            ),
            Ratio(f"time to open {what}", f"{seconds:.1f} s", "the limit of 5 s", seconds / 5.0, at_most=1.0),
        ]
    return rows


def _fill(directory: Path, count: int) -> None:
    """Makes empty files with numbers that are not padded, which take the longest to sort."""
    directory.mkdir(parents=True)
    descriptor = os.open(directory, os.O_RDONLY)
    for number in range(count):
        os.close(os.open(f"frame-{number}.png", os.O_CREAT | os.O_WRONLY, dir_fd=descriptor))
    os.close(descriptor)


def _run(work: str, route: Path) -> tuple[float, float]:
    """Returns seconds and peak memory in bytes of one process that does the work."""
    code = f"import json, os, sys, time\n{work}\n{_MEASURE}"
    output = subprocess.run([sys.executable, "-c", code, route], check=True, capture_output=True, text=True).stdout
    seconds, memory = json.loads(output)
    return seconds, memory
