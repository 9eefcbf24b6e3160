"""A second drive made from a recorded one: other speeds, stops, stretches in reverse, a robot that is carried off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError

__all__ = ["resample_drive"]

_LEG = 20  # frames after which a new speed is aimed at


def resample_drive(
    count: int,
    seed: int,
    *,
    speeds: tuple[float, float] = (0.7, 1.4),
    stop: float = 0.02,
    stop_frames: tuple[int, int] = (3, 8),
    reverse: float = 0.0,
    reverse_frames: tuple[int, int] = (5, 15),
    jumps: int = 0,
) -> NDArray[np.int64]:
    """Chooses frames of a recorded drive as if it had been driven otherwise.

    The speed goes from one random value to the next over every 20 frames, so it varies along the route. The drive ends
    when the last frame is reached.

    Args:
        count: Number of frames of the recorded drive, at least 2.
        seed: Of all that is random; the same arguments give the same drive.
        speeds: Slowest and fastest speed, in recorded frames a frame; positive.
        stop: Probability, at each frame, of a stop: the same frame over and over.
        stop_frames: Fewest and most frames of a stop.
        reverse: Probability, at each frame, of driving backwards for a while.
        reverse_frames: Fewest and most frames of such a stretch.
        jumps: Times that the robot is carried to a random frame, after equal parts of a drive of `count` frames.

    Returns:
        Positions in the recorded drive. Truth and descriptors of the new drive are these rows of the old ones.

    Raises:
        ConfigError: The drive is too short, or a speed is not positive.
    """
    if count < 2 or not 0 < speeds[0] <= speeds[1]:
        raise ConfigError(
            f"a drive of {count} frames cannot be driven at speeds of {speeds}; give 2 frames and positive speeds"
        )
    rng = np.random.default_rng(seed)
    carried = {max(1, count * (n + 1) // (jumps + 1)) for n in range(jumps)}
    chosen: list[int] = []
    position, backwards, leg = 0.0, 0, rng.uniform(*speeds, 2)
    for frame in range(20 * count):  # enough for any drive that goes on
        if frame % _LEG == 0:
            leg = np.array([leg[1], rng.uniform(*speeds)])
        if frame in carried:
            position = float(rng.integers(count))
        place = round(position)
        standing = int(rng.integers(stop_frames[0], stop_frames[1] + 1)) if rng.random() < stop else 1
        chosen += [place] * standing
        if backwards == 0 and rng.random() < reverse:
            backwards = int(rng.integers(reverse_frames[0], reverse_frames[1] + 1))
        if place == count - 1 and not backwards and frame > max(carried, default=0):
            break
        speed = leg[0] + (leg[1] - leg[0]) * (frame % _LEG) / _LEG
        position = float(np.clip(position + (-speed if backwards else speed), 0, count - 1))
        backwards = max(backwards - 1, 0)
    return np.array(chosen, np.int64)
