"""Small pictures of a map's frames."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from everplace.errors import MapError
from everplace.mapping.route_map import Map


def _without(address: Path, drive: str) -> Map:
    opened = Map.open(address)
    opened.remove(drive)
    return opened


def test_thumbnails_are_read_one_by_one_in_the_order_of_frames(three_map: Path) -> None:
    opened = Map.open(three_map)
    for changed in (opened, _without(three_map, "summer")):
        whole = changed.frames("thumbnail")["thumbnail"].to_pylist()
        read = changed.thumbnails()
        assert len(read) == len(whole)
        assert [read.read(row) for row in range(len(read))] == whole
    assert len(opened.thumbnails()) == 180  # of its own version


def test_a_map_that_was_removed_meanwhile_is_told(three_map: Path) -> None:
    read = Map.open(three_map).thumbnails()
    shutil.rmtree(three_map)
    with pytest.raises(MapError, match=r"the map .* is damaged \(.*\); restore a copy"):
        read.read(7)
