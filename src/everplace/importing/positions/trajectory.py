"""A camera's way through space: poses at given times, and how they are laid onto the plane of a route.

A route knows x, y and the heading, which is the direction of the optical axis as it is seen from above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from everplace.importing.containers.text_rows import TextRow
from everplace.route.traverse import Pose

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["OPTICAL_AXIS", "Trajectory", "Up", "plane_poses", "read_quaternion", "rotation_of"]

OPTICAL_AXIS = (0.0, 0.0, 1.0)
"""Where a camera looks in its own frame: x to the right, y down, z ahead."""

Up: TypeAlias = Literal["x", "y", "z", "-x", "-y", "-z"]
"""Which axis of the world points away from the ground."""

# (axis, sign) of the plane's x and y, so that x, y and up are right-handed. -y is the world of a camera that is
# held level: ahead is x and left is y.
_PLANES: dict[Up, tuple[tuple[int, float], tuple[int, float]]] = {
    "x": ((1, 1.0), (2, 1.0)),
    "y": ((2, 1.0), (0, 1.0)),
    "z": ((0, 1.0), (1, 1.0)),
    "-x": ((2, 1.0), (1, 1.0)),
    "-y": ((2, 1.0), (0, -1.0)),
    "-z": ((1, 1.0), (0, 1.0)),
}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a camera, or of the body that carries it, in order of time.

    Attributes:
        seconds: N, rising.
        positions: N×3 metres in the world.
        rotations: N rotations that turn the camera's (body's) axes into the world's.
    """

    seconds: NDArray[np.float64]
    positions: NDArray[np.float64]
    rotations: Rotation

    @classmethod
    def of(cls, seconds: Sequence[float], positions: Sequence[Sequence[float]], rotations: Rotation) -> Trajectory:
        """Makes one from poses in any order; of two at the same moment the first counts."""
        times, first = np.unique(np.asarray(seconds, dtype=np.float64), return_index=True)
        return cls(times, np.asarray(positions, dtype=np.float64).reshape(-1, 3)[first], rotations[first])

    def at(self, seconds: NDArray[np.float64], limit: float) -> tuple[NDArray[np.float64], Rotation, NDArray[np.bool_]]:
        """Tells where the camera was.

        Between two poses that are both near enough the position is interpolated on a straight line and the
        rotation on the shortest arc; where only one is, that one is taken.

        Args:
            seconds: M moments.
            limit: Seconds; a moment further than this from every pose has none.

        Returns:
            M×3 positions, M rotations, and M bool that say which of them are known.
        """
        from scipy.spatial.transform import Rotation

        last = len(self.seconds) - 1
        after = np.searchsorted(self.seconds, seconds).clip(0, last)
        # Before the first pose, after the last and at a pose itself both neighbours are the same one.
        before = np.where(seconds >= self.seconds[after], after, after - 1).clip(0, last)
        near_before = np.abs(seconds - self.seconds[before]) <= limit
        near_after = np.abs(self.seconds[after] - seconds) <= limit
        gap = self.seconds[after] - self.seconds[before]
        share = np.divide(seconds - self.seconds[before], gap, out=np.zeros_like(gap), where=gap > 0)
        share = np.where(near_before & near_after, share, np.where(near_after, 1.0, 0.0))
        positions = self.positions[before] + share[:, None] * (self.positions[after] - self.positions[before])
        turn = (self.rotations[before].inv() * self.rotations[after]).as_rotvec()
        rotations = self.rotations[before] * Rotation.from_rotvec(share[:, None] * turn)
        return positions, rotations, near_before | near_after


def plane_poses(
    positions: NDArray[np.float64],
    rotations: Rotation,
    up: Up,
    axis: Sequence[float] = OPTICAL_AXIS,
) -> list[Pose]:
    """Lays poses in space onto the plane.

    Args:
        positions: N×3 metres in the world.
        rotations: N rotations that turn the camera's (body's) axes into the world's.
        up: The world's axis that points up; the height is dropped.
        axis: The optical axis in the camera's (body's) frame.

    Returns:
        N poses. The heading of a camera that looks straight up or down is 0.
    """
    (i, sign_i), (j, sign_j) = _PLANES[up]
    ahead = rotations.apply(np.asarray(axis, dtype=np.float64)).reshape(-1, 3)
    headings = np.arctan2(sign_j * ahead[:, j], sign_i * ahead[:, i])
    x, y = sign_i * positions[:, i], sign_j * positions[:, j]
    return [Pose(*values) for values in np.stack([x, y, headings], axis=1).tolist()]


def read_quaternion(row: TextRow, start: int, *, w_first: bool) -> list[float]:
    """Reads a unit quaternion from four fields.

    Returns:
        x, y, z, w.

    Raises:
        RouteError: A field is missing or no number, or the quaternion's length is not 1 within 5 %.
    """
    q = row.floats(start, start + 4)
    if not 0.95**2 < sum(min(abs(value), 2.0) ** 2 for value in q) < 1.05**2:
        raise row.wrong(f"holds the quaternion {q}, whose length is not 1; correct it or leave the line out")
    return [*q[1:], q[0]] if w_first else q


def rotation_of(quaternions: Sequence[Sequence[float]]) -> Rotation:
    """Makes N rotations of quaternions x, y, z, w."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(np.asarray(quaternions, dtype=np.float64).reshape(-1, 4))
