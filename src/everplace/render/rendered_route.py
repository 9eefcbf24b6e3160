"""Writes a rendered route to disk: frames, ground-truth poses and `route.toml`."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from everplace.errors import MachineError
from everplace.files import require_free_directory, whole_directory
from everplace.progress import Progress, quiet
from everplace.render.frame import Drive, Pose, open_drive
from everplace.render.noise import profile
from everplace.render.render_config import CONDITIONS, RenderConfig
from everplace.render.road import Column
from everplace.render.world import World, make_world

__all__ = ["drive_poses", "render_route", "route_world"]

# Frames that a worker renders at a time: enough to make up for sending it the world.
_BATCH = 16
_BATCHES_AHEAD = 3
# Places over which a driver's offset from the ideal line stays alike.
_STEADY_PLACES = 6.0


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
    across, along, turn = (np.clip(profile(rng, config.places, _STEADY_PLACES), -2.5, 2.5) for _ in range(3))
    arc = config.spacing * np.arange(config.places) + config.longitudinal_std * along
    positions = world.road.x_of_arc(arc)
    road = world.road.lookup(positions.astype(np.float32)).astype(np.float64)
    heading = np.array([world.road.heading(float(x)) for x in positions])
    lateral = config.lateral_std * across - 1.75
    x = positions - lateral * np.sin(heading)
    y = road[:, Column.CENTRE] + lateral * np.cos(heading)
    return np.column_stack([x, y, heading + np.radians(config.heading_std) * turn])


def render_route(out: Path, config: RenderConfig, *, progress: Progress = quiet, workers: int = 1) -> None:
    """Renders a route: one directory a condition with its frames and `poses.csv`, and `route.toml`.

    The same configuration gives the same bytes, whatever the number of workers. The directory appears whole or not
    at all.

    Args:
        out: The route's directory; it must not exist, or be empty.
        config: What to render.
        progress: Shows how far it has come.
        workers: Processes that render at the same time. With more than one, the program that calls this must be
            importable without running (`if __name__ == "__main__"`), as for any use of multiprocessing.

    Raises:
        ConfigError: `out` exists and is not an empty directory.
        StorageError: The files cannot be written.
        MachineError: A worker was killed.
    """
    require_free_directory(out)
    world = route_world(config)
    with whole_directory(out) as directory, _pool(workers) as pool:
        for condition in config.conditions:
            drive = open_drive(world, condition)
            poses = drive_poses(world, config, condition)
            frames = _frames(drive, poses.tolist(), config.size, pool)
            shown = progress(frames, f"rendering {condition}", config.places)
            _write_traverse(directory / condition, config, poses, shown)
        table = {
            "tolerance": 1,
            "truth_from": "the rendered world",
            "traverses": {name: {"condition": name} for name in config.conditions},
        }
        (directory / "route.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
        if out.is_dir():
            out.rmdir()  # it was empty; a rename onto it would fail on Windows


def _write_traverse(
    directory: Path, config: RenderConfig, poses: NDArray[np.float64], frames: Iterator[NDArray[np.uint8]]
) -> None:
    directory.mkdir()
    digits = max(5, len(str(config.places - 1)))
    stems = [f"{place:0{digits}d}" for place in range(config.places)]
    options = [cv2.IMWRITE_JPEG_QUALITY, config.quality] if config.format == "jpg" else []
    for stem, frame in zip(stems, frames, strict=True):
        path = directory / f"{stem}.{config.format}"
        _, data = cv2.imencode(path.suffix, cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), options)
        path.write_bytes(data.tobytes())
    lines = [f"{stem},{x:.4f},{y:.4f},{heading:.6f}" for stem, (x, y, heading) in zip(stems, poses, strict=True)]
    (directory / "poses.csv").write_text("\n".join(["stem,x,y,heading", *lines, ""]), encoding="utf-8")


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Executor | None]:
    """Gives worker processes, or None to work in this one."""
    if workers <= 1:
        yield None
        return
    # Ctrl-C reaches the workers too; the parent alone answers it.
    quietly = (signal.SIGINT, signal.SIG_IGN)
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=signal.signal, initargs=quietly)
    try:
        yield pool
    except BrokenProcessPool as error:
        raise MachineError("a process that renders was killed; free memory or render with one worker") from error
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def _sigint_ignored() -> Iterator[None]:
    """Ignores Ctrl-C for a moment: a process that starts meanwhile ignores it from its first instruction on."""
    previous = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or previous is None:
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _frames(
    drive: Drive, poses: Sequence[Pose], size: tuple[int, int], pool: Executor | None
) -> Iterator[NDArray[np.uint8]]:
    """Renders in order, in batches, never more than a few ahead of what was taken."""
    if pool is None:
        for pose in poses:
            yield drive.frame(pose, size)
        return
    drive.nursery.grow_all()  # once here rather than in every batch
    waiting: deque[Future[list[NDArray[np.uint8]]]] = deque()
    for first in range(0, len(poses), _BATCH):
        with _sigint_ignored():  # handing over work may start a worker
            waiting.append(pool.submit(_render, drive, poses[first : first + _BATCH], size))
        if len(waiting) > _BATCHES_AHEAD:
            yield from waiting.popleft().result()
    for future in waiting:
        yield from future.result()


def _render(drive: Drive, poses: Sequence[Pose], size: tuple[int, int]) -> list[NDArray[np.uint8]]:
    return [drive.frame(pose, size) for pose in poses]
