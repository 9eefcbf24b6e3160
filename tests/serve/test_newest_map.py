"""A newer version is read beside the answers, and nobody waits long for it."""

from __future__ import annotations

import asyncio
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from everplace.mapping.route_map import Map
from everplace.serve import newest_map
from everplace.serve.loaded_map import LoadedMap
from everplace.serve.newest_map import NewestMap
from everplace.serve.service_limits import DEFAULT_LIMITS

pytestmark = pytest.mark.slow
AT_ONCE = replace(DEFAULT_LIMITS, look_seconds=0.0, look_wait_seconds=30.0)
SLOW_TO_READ = """
import sys, time
from dataclasses import replace
from everplace.serve import http_server, newest_map
from everplace.serve.service_limits import DEFAULT_LIMITS

read = newest_map.LoadedMap

def slowly(map_):
    newest_map.LoadedMap = forever
    return read(map_)

def forever(map_):
    print("reads", flush=True)
    time.sleep(300)

newest_map.LoadedMap = slowly
http_server.serve_map(sys.argv[1], port=0, limits=replace(DEFAULT_LIMITS, look_seconds=0.0, look_wait_seconds=0.2))
"""


async def _until(newest: NewestMap, version: int) -> LoadedMap:
    end = time.monotonic() + 30
    while (loaded := await newest.current()).version != version:
        assert time.monotonic() < end
        await asyncio.sleep(0.02)
    return loaded


def test_a_newer_version_answers_whoever_finds_the_look_due(three_map: Path) -> None:
    async def story() -> None:
        newest = NewestMap(three_map, AT_ONCE)
        assert (await newest.current()) is newest.loaded
        Map.open(three_map).remove("winter")
        assert (await newest.current()).version == 4

    asyncio.run(story())


def test_a_map_made_anew_with_as_many_versions_is_another_map(three_map: Path, summer_map: Path) -> None:
    async def story() -> None:
        newest = NewestMap(three_map, AT_ONCE)
        before = await newest.current()
        for _ in range(2):
            time.sleep(1.1)  # a version knows the second it was made in
            Map.open(summer_map).restore(1)
        shutil.rmtree(three_map)
        shutil.copytree(summer_map, three_map)
        after = await newest.current()
        assert after.version == before.version == 3
        assert len(after.thumbnails) < len(before.thumbnails)

    asyncio.run(story())


def test_nobody_waits_long_for_a_map_that_is_slow_to_read(three_map: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, reads = threading.Event(), []

    def slow(map_: Map) -> LoadedMap:
        reads.append(map_.version)
        gate.wait(60)
        return LoadedMap(map_)

    async def story() -> None:
        newest = NewestMap(three_map, replace(AT_ONCE, look_wait_seconds=0.1))
        monkeypatch.setattr(newest_map, "LoadedMap", slow)
        Map.open(three_map).remove("winter")
        answers = [await asyncio.wait_for(newest.current(), 20) for _ in range(5)]
        assert {answer.version for answer in answers} == {3}
        assert reads == [4]  # once, whoever asks meanwhile
        gate.set()
        await _until(newest, 4)

    asyncio.run(story())


def test_ctrl_c_ends_the_service_while_a_map_is_read(three_map: Path) -> None:
    import httpx

    command = [sys.executable, "-c", SLOW_TO_READ, str(three_map)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        address = process.stdout.readline().split(" at ")[1].split(" ")[0]
        Map.open(three_map).remove("winter")
        assert httpx.get(f"{address}map", trust_env=False, timeout=20).json()["version"] == 3
        assert process.stdout.readline() == "reads\n"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)
    finally:
        process.kill()
