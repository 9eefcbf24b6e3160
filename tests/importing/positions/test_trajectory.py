"""Poses in space: interpolated in time, laid onto the plane."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from everplace.importing.positions.trajectory import Trajectory, Up, plane_poses

UPS: list[Up] = ["x", "y", "z", "-x", "-y", "-z"]


def trajectory(seconds: list[float]) -> Trajectory:
    rng = np.random.default_rng(3)
    return Trajectory.of(seconds, rng.uniform(-9, 9, (len(seconds), 3)).tolist(), Rotation.random(len(seconds), rng=1))


def test_a_pose_at_its_own_moment_and_the_order_of_lines() -> None:
    ways = trajectory([3.0, 1.0, 2.0, 1.0])  # the second line of moment 1 does not count
    assert ways.seconds.tolist() == [1.0, 2.0, 3.0]
    positions, rotations, known = ways.at(np.array([1.0, 2.0, 3.0]), 0.0)
    np.testing.assert_allclose(positions, ways.positions)
    np.testing.assert_allclose(rotations.as_matrix(), ways.rotations.as_matrix(), atol=1e-12)
    assert known.all()


@given(st.floats(1.0, 5.0), st.floats(0.6, 4.0))
@settings(max_examples=50, deadline=None)
def test_between_two_poses_against_scipy(moment: float, limit: float) -> None:
    ways = trajectory([1.0, 2.0, 2.5, 5.0])
    positions, rotations, known = ways.at(np.array([moment]), 4.0)
    assert known.all()
    expected = [np.interp(moment, ways.seconds, ways.positions[:, axis]) for axis in range(3)]
    np.testing.assert_allclose(positions[0], expected, atol=1e-9)
    slerp = Slerp(ways.seconds, ways.rotations)(moment)
    assert (rotations[0].inv() * slerp).magnitude() < 1e-6
    assert ways.at(np.array([moment]), limit)[2][0] == (np.abs(ways.seconds - moment).min() <= limit)


def test_where_only_one_pose_is_near_it_is_taken() -> None:
    ways = trajectory([0.0, 10.0])
    positions, _, known = ways.at(np.array([-0.5, 0.4, 5.0, 9.9, 10.5, 11.0]), 0.5)
    assert known.tolist() == [True, True, False, True, True, False]
    np.testing.assert_allclose(positions[[0, 1, 3, 4]], ways.positions[[0, 0, 1, 1]])


@pytest.mark.parametrize("up", UPS)
def test_planes_are_right_handed_and_turn_with_the_camera(up: Up) -> None:
    """A camera that drives along its optical axis and turns left: its heading is its direction, and rises."""
    axis = np.eye(3)["xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    ahead = np.roll(np.eye(3)["xyz".index(up[-1])], 1)
    turns = Rotation.from_rotvec(np.outer([0.0, 0.3, 0.6], axis))
    looks = turns.apply(ahead)
    first, _ = Rotation.align_vectors([ahead, -axis], [[0, 0, 1], [0, 1, 0]])
    poses = plane_poses(np.cumsum(looks, axis=0), turns * first, up)
    headings = np.unwrap([pose.heading for pose in poses])
    np.testing.assert_allclose(np.diff(headings), 0.3, atol=1e-9)
    for before, after in pairwise(poses):
        travelled = math.atan2(after.y - before.y, after.x - before.x)
        assert math.isclose(math.cos(travelled - after.heading), 1.0, abs_tol=1e-9)
