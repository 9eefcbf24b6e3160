"""The service under 50 clients that never pause, against one client: errors, latency, throughput, memory.

`python -m benchmarks.serving 120` lets them ask for two minutes.
"""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import numpy as np
import psutil

from benchmarks.ratio import Ratio
from everplace.mapping.route_map import Map
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

CLIENTS = 50
SECONDS = 10.0
WARM = 3.0
PLACES = 150
SIZE = (240, 320)


@dataclass
class Load:
    """What clients met.

    Attributes:
        seconds: Of each answer, in the order of their ends.
        statuses: Of those that were no 200, and of errors 0.
        took: How long they asked.
    """

    seconds: list[float] = field(default_factory=list)
    statuses: list[int] = field(default_factory=list)
    took: float = 0.0

    @property
    def rate(self) -> float:
        """Answers a second."""
        return len(self.seconds) / self.took

    def milliseconds(self, percent: float) -> float:
        """Below which so many of a hundred answers lie."""
        return 1000 * float(np.percentile(self.seconds, percent))


def measure(scratch: Path, seconds: float = SECONDS) -> list[Ratio]:
    config = {"places": PLACES, "size": SIZE, "conditions": ("summer", "winter"), "format": "jpg"}
    render_route(scratch / "route", render_config(config))
    Map.create(scratch / "map", scratch / "route" / "summer", method="hog16")
    frames = [path.read_bytes() for path in sorted((scratch / "route" / "winter").glob("*.jpg"))]
    command = [sys.executable, "-m", "everplace", "serve", str(scratch / "map"), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+/", process.stdout.readline())
            assert found is not None
            asyncio.run(_load(found[0], frames, CLIENTS, WARM))
            one = asyncio.run(_load(found[0], frames, 1, min(seconds, SECONDS)))
            before = psutil.Process(process.pid).memory_info().rss / 2**20
            many = asyncio.run(_load(found[0], frames, CLIENTS, seconds))
            after = psutil.Process(process.pid).memory_info().rss / 2**20
        finally:
            process.terminate()
    what = f"service, {CLIENTS} clients for {seconds:.0f} s"
    count = len(many.seconds) + len(many.statuses)
    p50, p99 = many.milliseconds(50), many.milliseconds(99)
    return [
        Ratio(f"{what}: errors", f"{len(many.statuses)}", f"{count} requests", len(many.statuses) / count, at_most=0.0),
        Ratio(f"{what}: p99", f"{p99:.0f} ms", f"p50 {p50:.0f} ms", p99 / p50, at_most=3.0),
        Ratio(
            f"{what}: rate", f"{many.rate:.0f}/s", f"one client {one.rate:.0f}/s", many.rate / one.rate, at_least=1.0
        ),
        Ratio(f"{what}: memory", f"{after:.0f} MiB", f"{before:.0f} MiB before", after / before, at_most=1.1),
    ]


async def _load(url: str, frames: list[bytes], clients: int, seconds: float) -> Load:
    load, start = Load(), time.perf_counter()

    async def ask(number: int) -> None:
        async with httpx.AsyncClient(base_url=url, timeout=60, trust_env=False) as client:
            place = number
            while time.perf_counter() - start < seconds:
                begin, place = time.perf_counter(), (place + 1) % len(frames)
                try:
                    answer = await client.post(
                        "/localize", files={"image": ("frame.jpg", frames[place])}, data={"session": f"client-{number}"}
                    )
                except httpx.HTTPError:
                    load.statuses.append(0)
                    continue
                if answer.status_code == 200:
                    load.seconds.append(time.perf_counter() - begin)
                else:
                    load.statuses.append(answer.status_code)

    await asyncio.gather(*(ask(number) for number in range(clients)))
    load.took = time.perf_counter() - start
    return load


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as directory:
        for row in measure(Path(directory), float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS):
            print(f"{row.what}: {row.measured}, {row.against}")
