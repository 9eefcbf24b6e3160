"""Writes a rendered route to disk: frames, ground-truth poses and `route.toml`."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from everplace.data.render.config import CONDITIONS, RenderConfig
from everplace.data.render.frame import Drive, Pose, open_drive
from everplace.data.render.noise import profile
from everplace.data.render.road import Column
from everplace.data.render.world import World, make_world
from everplace.errors import ConfigError, StorageError
from everplace.files import readable, whole_directory
from everplace.progress import Progress, quiet

__all__ = ["drive_poses", "render_route", "route_world"]

_AHEAD = 8
# Places over which a driver's offset from the ideal line stays alike.
_STEADY = 6.0


def route_world(config: RenderConfig) -> World:
    """Makes the world that a configuration's route leads through."""
    return make_world(config.seed, config.places * config.spacing)


def drive_poses(world: World, config: RenderConfig, condition: str) -> NDArray[np.float64]:
    """Returns where the camera was at each place on the drive under a condition.

    The ideal line keeps to the right lane. Each drive departs from it smoothly: across the road, along it and in
    heading, with the standard deviations of the configuration, each at most 2.5 times as far.

    Returns:
        N × 3: x, y in metres, heading in radians.
    """
    rng = np.random.default_rng([config.seed, 3, CONDITIONS.index(condition)])
    across, along, turn = (np.clip(profile(rng, config.places, _STEADY), -2.5, 2.5) for _ in range(3))
    arc = config.spacing * np.arange(config.places) + config.longitudinal_std * along
    positions = world.road.x_of_arc(arc)
    road = world.road.lookup(positions.astype(np.float32)).astype(np.float64)
    heading = np.array([world.road.heading(float(x)) for x in positions])
    lateral = config.lateral_std * across - 1.75
    x = positions - lateral * np.sin(heading)
    y = road[:, Column.CENTRE] + lateral * np.cos(heading)
    return np.column_stack([x, y, heading + np.radians(config.heading_std) * turn])


def render_route(out: Path, config: RenderConfig, *, progress: Progress = quiet, workers: int = 2) -> None:
    """Renders a route: one directory a condition with its frames and `poses.csv`, and `route.toml`.

    The same configuration gives the same bytes, whatever the number of workers. The directory appears whole or not
    at all.

    Args:
        out: The route's directory; it must not exist, or be empty.
        config: What to render.
        progress: Shows how far it has come.
        workers: Threads that render at the same time.

    Raises:
        ConfigError: `out` exists and is not an empty directory.
        StorageError: The files cannot be written.
    """
    _refuse_occupied(out)
    world = route_world(config)
    with whole_directory(out) as directory:
        for condition in config.conditions:
            _write_traverse(directory / condition, world, config, condition, progress, workers)
        table = {"tolerance": 1, "traverses": {name: {"condition": name} for name in config.conditions}}
        (directory / "route.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
        if out.is_dir():
            out.rmdir()  # it was empty; a rename onto it would fail on Windows


def _refuse_occupied(out: Path) -> None:
    try:
        free = not out.exists() or (out.is_dir() and not any(out.iterdir()))
    except OSError as error:
        raise StorageError(
            f"cannot look into {readable(out)}: {error.strerror}; choose another place"
        ) from error
    if not free:
        raise ConfigError(f"{readable(out)} is not empty: choose another place")


def _write_traverse(
    directory: Path, world: World, config: RenderConfig, condition: str, progress: Progress, workers: int
) -> None:
    directory.mkdir()
    drive = open_drive(world, condition)
    poses = drive_poses(world, config, condition)
    digits = max(5, len(str(config.places - 1)))
    stems = [f"{place:0{digits}d}" for place in range(config.places)]
    frames = _frames(
        drive, [(float(x), float(y), float(heading)) for x, y, heading in poses], config.size, workers
    )
    options = [cv2.IMWRITE_JPEG_QUALITY, config.quality] if config.format == "jpg" else []
    for stem, frame in zip(stems, progress(frames, f"rendering {condition}", config.places), strict=True):
        path = directory / f"{stem}.{config.format}"
        done, data = cv2.imencode(path.suffix, cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), options)
        if not done:
            raise StorageError(f"cannot encode {readable(path)}: choose the other format")
        path.write_bytes(data.tobytes())
    lines = [
        f"{stem},{x:.4f},{y:.4f},{heading:.6f}" for stem, (x, y, heading) in zip(stems, poses, strict=True)
    ]
    (directory / "poses.csv").write_text("\n".join(["stem,x,y,heading", *lines, ""]), encoding="utf-8")


def _frames(
    drive: Drive, poses: list[Pose], size: tuple[int, int], workers: int
) -> Iterator[NDArray[np.uint8]]:
    """Renders in order on threads, never far ahead of what was taken."""
    with ThreadPoolExecutor(workers) as pool:
        waiting = [pool.submit(drive.frame, pose, size) for pose in poses[:_AHEAD]]
        for index in range(len(poses)):
            yield waiting.pop(0).result()
            if index + _AHEAD < len(poses):
                waiting.append(pool.submit(drive.frame, poses[index + _AHEAD], size))
