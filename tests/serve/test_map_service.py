"""What happens to the map behind a running service."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest
from tests.serve.running_service import RunningService, running

from everplace.mapping.route_map import Map

pytestmark = pytest.mark.slow


def wait(service: RunningService, version: int) -> None:
    """Until the service answers from a version."""
    end = time.monotonic() + 30
    while service.client.get("/map").json()["version"] != version:
        assert time.monotonic() < end
        time.sleep(0.1)


def test_a_map_that_loses_a_drive(three_map: Path, winter: list[Path]) -> None:
    with running(three_map, look_seconds=0.1) as service:
        assert service.localize(winter[30]).json()["drive"] == "winter"
        tag = service.client.get("/frames/125").headers["etag"]
        Map.open(three_map).remove("winter")
        wait(service, 4)
        assert service.localize(winter[30]).json()["drive"] != "winter"
        assert service.client.get("/frames/125").status_code == 404
        kept = service.client.get("/frames/5", headers={"If-None-Match": tag})
        assert (kept.status_code, kept.headers["etag"] != tag) == (200, True)
        Map.open(three_map).restore(3)
        wait(service, 5)
        assert service.localize(winter[30]).json()["drive"] == "winter"


def test_a_map_that_goes_away_goes_on_answering(summer_map: Path, winter: list[Path]) -> None:
    with running(summer_map, look_seconds=0.1) as service:
        before = service.localize(winter[30]).json()
        shutil.rmtree(summer_map)
        time.sleep(0.2)
        for _ in range(3):
            time.sleep(0.15)
            assert service.localize(winter[30]).json() == before
        assert service.client.get("/map").status_code == 200
        lost = service.client.get("/frames/5")
        assert (lost.status_code, lost.headers["retry-after"]) == (503, "5")
        assert str(summer_map.parent) not in lost.text
        assert service.process.stderr is not None
        service.process.terminate()
        said = service.process.stderr.read()
        assert said.count("version 1 goes on answering: there is no map at") == 1  # once, not with every look
