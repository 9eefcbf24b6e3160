from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from everplace.errors import ConfigError
from everplace.render.frame import Drive, Pose, camera_at, open_drive
from everplace.render.painter import visible_plants
from everplace.render.render_config import CONDITIONS, RenderConfig
from everplace.render.rendered_route import drive_poses
from everplace.render.sprites import Plant
from everplace.render.terrain import FAR
from everplace.render.world import World


@pytest.fixture(scope="module")
def drives(world: World) -> dict[str, Drive]:
    return {condition: open_drive(world, condition) for condition in CONDITIONS}


@pytest.fixture(scope="module")
def poses(world: World, config: RenderConfig) -> list[Pose]:
    return [(float(x), float(y), float(heading)) for x, y, heading in drive_poses(world, config, "summer")]


@pytest.mark.parametrize("size", [(16, 16), (64, 128), (120, 90), (480, 640)])
def test_a_frame_has_the_size_asked_for(drives: dict[str, Drive], poses: list[Pose], size: tuple[int, int]) -> None:
    frame = drives["rain"].frame(poses[3], size)
    assert frame.shape == (*size, 3)
    assert frame.dtype == np.uint8
    assert frame.std() > 10


def test_the_same_place_has_the_same_geometry_under_every_condition(
    world: World, drives: dict[str, Drive], poses: list[Pose]
) -> None:
    for place in (2, 11, 25):
        camera = camera_at(world, poses[place], (96, 192))
        depths = {condition: drive.layers(camera).depth for condition, drive in drives.items()}
        assert 0.2 < (depths["summer"] < FAR).mean() < 1
        plants = visible_plants(world.plants, camera)
        firm = np.ones((96, 192), bool)
        for kind, box in zip(plants.plants.kinds, plants.boxes, strict=True):
            if kind != Plant.CONIFER:
                left, top, right, bottom = np.clip(np.round(box), 0, 192).astype(int)
                firm[max(0, top - 1) : bottom + 2, max(0, left - 1) : right + 2] = False
        assert firm.mean() > 0.25
        for depth in depths.values():
            np.testing.assert_array_equal(depth[firm], depths["summer"][firm])
        # Leaves or not, a tree stands where it stands: what differs, differs inside the crowns alone.
        np.testing.assert_array_equal(depths["summer"], depths["night"])


def test_conditions_look_different(drives: dict[str, Drive], poses: list[Pose]) -> None:
    frames = {name: drive.frame(poses[11], (64, 128)).astype(np.float64) for name, drive in drives.items()}
    for (name, frame), (other, second) in combinations(frames.items(), 2):
        assert np.abs(frame - second).mean() > 8, (name, other)
    assert frames["night"].mean() < 80 < frames["summer"].mean()
    below = slice(40, 64)
    assert frames["winter"][below].mean() > frames["summer"][below].mean() + 20
    red, green, blue = frames["autumn"].mean(axis=(0, 1))
    assert red > green > blue


def test_a_frame_is_a_function_of_its_arguments(world: World, drives: dict[str, Drive], poses: list[Pose]) -> None:
    first = drives["night"].frame(poses[7], (48, 64))
    drives["night"].frame(poses[8], (48, 64))
    np.testing.assert_array_equal(drives["night"].frame(poses[7], (48, 64)), first)
    np.testing.assert_array_equal(open_drive(world, "night").frame(poses[7], (48, 64)), first)


def test_moving_the_camera_moves_the_picture(drives: dict[str, Drive], poses: list[Pose]) -> None:
    x, y, heading = poses[11]
    here, turned = (
        drives["rain"].layers(camera_at(drives["rain"].world, p, (96, 192)))
        for p in ((x, y, heading), (x, y, heading + 0.1))
    )
    # Turning 0.1 rad to the left moves the far scene right by focal * tan(0.1) = 12.7 pixels.
    far = slice(0, 44)
    shifts = [np.abs(here.light[far, 40:120] - turned.light[far, 40 + s : 120 + s]).mean() for s in range(-20, 21)]
    assert int(np.argmin(shifts)) - 20 in range(11, 15)


def test_an_unknown_condition_is_refused(world: World) -> None:
    with pytest.raises(ConfigError, match="monsoon"):
        open_drive(world, "monsoon")
