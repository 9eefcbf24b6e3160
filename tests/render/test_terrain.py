from __future__ import annotations

import numpy as np
import pytest

from everplace.render.frame import camera_at
from everplace.render.road import Biome, Column
from everplace.render.terrain import FAR, view_terrain
from everplace.render.world import World, make_world


def test_the_road_is_level_across_and_follows_its_profile(world: World) -> None:
    x = np.arange(10, 400, 7, dtype=np.float32)[:, None]
    centre = world.road.lookup(x)[..., Column.CENTRE]
    for lateral in (-3.0, 0.0, 3.0):
        heading = np.array([[world.road.heading(float(v))] for v in x[:, 0]], np.float32)
        px = np.asarray(x - lateral * np.sin(heading), np.float32)
        py = np.asarray(centre + lateral * np.cos(heading), np.float32)
        surface = world.terrain.surface(px, py)
        np.testing.assert_allclose(surface.lateral, lateral, atol=0.15)
        np.testing.assert_allclose(
            surface.height.tolist(), world.road.lookup(px)[..., Column.HEIGHT].tolist(), atol=0.02
        )
        assert not surface.canopy.any()
        assert not surface.water.any()


def test_depth_agrees_with_a_ray_that_is_marched_in_small_steps(world: World) -> None:
    x = 60.0
    camera = camera_at(world, (x, world.road.at(x, Column.CENTRE), world.road.heading(x)), (96, 192))
    land = view_terrain(world.terrain, camera)
    checked = 0
    for row in range(land.top + 6, 96, 9):
        for column in range(4, 192, 37):
            slope, sideways = camera.row_slopes()[row], camera.column_slopes()[column]
            depth = np.geomspace(1.2, FAR, 20_000).astype(np.float32)[:, None]
            height = world.terrain.surface(*camera.ground_points(depth, sideways[None, None])).height
            below = np.flatnonzero(height[:, 0] >= camera.z + slope * depth[:, 0])
            expected = depth[below[0], 0] if len(below) else FAR
            if expected < 150:
                assert land.depth[row - land.top, column] == pytest.approx(expected, rel=0.08)
                checked += 1
    assert checked > 20


def test_lakes_lie_level() -> None:
    world = make_world(0, 1600)
    lakes = [segment for segment in world.road.segments if segment.left == Biome.LAKE]
    assert lakes
    for segment in lakes:
        x = np.linspace(segment.start + 30, segment.end - 30, 12, dtype=np.float32)[:, None]
        surface = world.terrain.surface(x, world.road.lookup(x)[..., Column.CENTRE] + np.float32(60))
        wet = surface.water
        assert wet.mean() > 0.5
        assert np.ptp(surface.height[wet]) < 1e-3
