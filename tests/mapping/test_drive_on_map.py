"""Which places the frames of a new drive show: by names that are to be believed, poses, or images."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.mapping.drives import images_of, write_drive, write_video

import everplace as ep
from everplace.errors import MapError
from everplace.mapping.placement import Align
from everplace.mapping.route_map import AddedDrive, Map


def test_names_are_believed_where_the_images_agree(summer_map: Path, unchanged_rendered_route: Path) -> None:
    added = Map.open(summer_map).add(unchanged_rendered_route / "autumn")
    assert added == AddedDrive("autumn", 60, 60, 0, "names", added.agreement, 2)
    assert added.agreement is not None
    assert added.agreement >= 0.9


def slower(images: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    return [image for image in images for _ in range(2)]


def faster(images: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    return images[::2]


def later(images: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    return images[12:]


@pytest.mark.slow
@pytest.mark.parametrize("speed", [slower, faster, later])
def test_numbers_of_videos_of_another_speed_are_not_believed(
    unchanged_rendered_route: Path,
    tmp_path: Path,
    speed: Callable[[list[NDArray[np.uint8]]], list[NDArray[np.uint8]]],
) -> None:
    """Both videos number their frames from 0, so that nearly all names of the second are names of the first."""
    pytest.importorskip("av", reason="needs the extra video")
    summer = images_of(unchanged_rendered_route / "summer")
    autumn = images_of(unchanged_rendered_route / "autumn")
    m = Map.create(tmp_path / "map", write_video(tmp_path / "first.mp4", summer), method="hog16")
    added = m.add(write_video(tmp_path / "second.mp4", speed(autumn)))
    assert added.how == "images"
    assert added.agreement is not None
    assert added.agreement < 0.5
    assert added.sure >= 0.6 * added.frames
    true = np.array(speed([np.full((1, 1), index, np.uint8) for index in range(60)])).ravel()
    table = m.frames("place", "sure")
    here = np.array(table["drive"].to_pylist()) == "second"
    sure, places = np.asarray(table["sure"])[here], np.asarray(table["place"])[here]
    assert (np.abs(places[sure] - true[sure]) <= 1).mean() >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize(("align", "how"), [("names", "names"), ("images", "images"), ("poses", "poses")])
def test_what_tells_the_places_can_be_chosen(
    summer_map: Path, unchanged_rendered_route: Path, align: Align, how: str
) -> None:
    route = ep.open_route(unchanged_rendered_route)
    added = Map.open(summer_map).add(route["autumn"], align=align)
    assert added.how == how
    assert added.sure >= 50


def test_names_that_nobody_has_are_refused(summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive", images_of(unchanged_rendered_route / "autumn")[:5], first=500)
    with pytest.raises(MapError, match="no frame of the drive has the name of one of the map; align by images"):
        Map.open(summer_map).add(drive, align="names")
    with pytest.raises(MapError, match="needs poses of the map and of the drive"):
        Map.open(summer_map).add(drive, align="poses")
    assert Map.open(summer_map).version == 1


@pytest.mark.slow
def test_a_detour_becomes_new_places(summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path) -> None:
    """In the middle of the drive stand 20 frames that show no place of the map."""
    autumn = images_of(unchanged_rendered_route / "autumn")
    rng = np.random.default_rng(1)
    detour = [
        np.asarray(cv2.resize(rng.integers(0, 256, (6, 9, 3), dtype=np.uint8), (128, 64)), np.uint8) for _ in range(20)
    ]
    drive = write_drive(tmp_path / "detour", [*autumn[:20], *detour, *autumn[45:]], first=1000)
    m = Map.open(summer_map)
    added = m.add(drive)
    table = m.frames("place", "sure", "number")
    here = np.array(table["drive"].to_pylist()) == "detour"
    away = (np.asarray(table["number"])[here] >= 20) & (np.asarray(table["number"])[here] < 40)
    assert not np.asarray(table["sure"])[here][away].any()
    assert (np.asarray(table["place"])[here][away] >= 60).mean() >= 0.8
    assert added.new_places >= 16
    assert np.asarray(table["sure"])[here][~away].mean() >= 0.7
    assert m.info()["places"] == 60 + added.new_places
    assert m.verify() == []
    again = m.add(write_drive(tmp_path / "again", [*autumn[:20], *detour, *autumn[45:]], first=2000), name="again")
    assert again.sure >= 45  # the detour is known by now
    assert again.new_places <= 10
