"""Whether a map survives: writers that are killed at random moments, while others read.

    python -m studies map_kills --out OUT [--kills 200] [--readers 20]

A writer adds a drive if the map does not hold it, else removes it, and is killed at a random moment of that. What it
had acknowledged must be there, the map must open, and its frames and descriptors must be those of its drives. In the
end everything is verified, and a writer that is not killed goes on.
"""

from __future__ import annotations

import argparse
import multiprocessing
import shutil
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np

from everplace.errors import EverplaceError
from everplace.files import write_json
from everplace.mapping.route_map import Map
from everplace.render.render_config import RenderConfig
from everplace.render.rendered_route import render_route

__all__ = ["main"]

_NAME = "winter"
_PAUSE = 3.0  # of a reader: twenty of them leave the writers some processor time


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies map_kills", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="directory for the map and metrics.json")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--readers", type=int, default=20)
    parser.add_argument("--places", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    route, address = given.out / "route", given.out / "map"
    shutil.rmtree(address, ignore_errors=True)
    if not route.exists():
        render_route(route, RenderConfig(places=given.places, size=(32, 64), conditions=("summer", "winter")))
    Map.create(address, route / "summer", method="hog16")

    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload(["everplace.mapping.route_map", "everplace.describe.registry", "torch"])
    stop = processes.Event()
    faults, reads = processes.Queue(), processes.Queue()
    readers = [
        processes.Process(target=_read, args=(address, given.places, stop, faults, reads)) for _ in range(given.readers)
    ]
    for reader in readers:
        reader.start()
    result = {"kills": 0, "changes": 0, "acknowledged": 0, "lost": 0, "unreadable": 0, "readers": given.readers}
    rng = np.random.default_rng(given.seed)
    slowest = _timed(processes, address, route / _NAME)
    for number in range(1, given.kills + 1):
        for what in _killed(processes, address, route / _NAME, given.places, float(rng.uniform(0, 1.1 * slowest))):
            result[what] += 1
        if number % 10 == 0:
            print(result, flush=True)
    stop.set()
    for reader in readers:
        reader.join()
    found: dict[str, Any] = {
        **result,
        "reads": sum(reads.get() for _ in readers),
        "reader_faults": [faults.get() for _ in range(faults.qsize())],
        "verify": Map.open(address).verify(),
    }
    _timed(processes, address, route / _NAME)
    write_json(given.out / "metrics.json", found)
    print(found)


def _killed(processes: Any, address: Path, drive: Path, places: int, seconds: float) -> Iterator[str]:
    """Kills a writer after some time; yields what came of it, to be counted."""
    before = Map.open(address)
    here, there = processes.Pipe()
    writer = processes.Process(target=_write, args=(address, drive, _NAME not in before.drives, there))
    writer.start()
    here.recv()
    time.sleep(seconds)
    writer.kill()
    writer.join()
    yield "kills"
    acknowledged = here.poll()
    if acknowledged:
        yield "acknowledged"
    try:
        after = Map.open(address)
        _require_whole(after, places)
    except EverplaceError as error:
        print(error)
        yield "unreadable"
        return
    changed = after.version > before.version
    if changed:
        yield "changes"
    if (acknowledged and not changed) or not set(before.drives) - {_NAME} <= set(after.drives):
        yield "lost"


def _timed(processes: Any, address: Path, drive: Path) -> float:
    """Seconds of a change that is not killed; the map is left with or without the drive, other than before."""
    here, there = processes.Pipe()
    writer = processes.Process(target=_write, args=(address, drive, _NAME not in Map.open(address).drives, there))
    writer.start()
    here.recv()
    start = time.monotonic()
    here.recv()
    writer.join()
    return time.monotonic() - start


def _write(address: Path, drive: Path, adds: bool, channel: Connection) -> None:
    opened = Map.open(address)
    opened.describer()
    channel.send("ready")
    if adds:
        opened.add(drive)
    else:
        opened.remove(_NAME)
    channel.send("done")


def _read(address: Path, places: int, stop: Event, faults: Any, reads: Any) -> None:
    count = 0
    while not stop.wait(_PAUSE):
        try:
            _require_whole(Map.open(address), places)
        except Exception as error:  # any is a finding
            faults.put(repr(error))
        count += 1
    reads.put(count)


def _require_whole(opened: Map, places: int) -> None:
    """Every drive of a map is there with all its frames, and each frame with its descriptor."""
    counts = {len(opened.frames()), len(opened.descriptors()), places * len(opened.drives)}
    if len(counts) != 1:
        raise EverplaceError(f"version {opened.version} is not whole: {counts}")
