"""A method whose work is spread over the machines of a Ray cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from everplace.choices import Engine
from everplace.cluster import map_on_cluster, require_ray
from everplace.describe.describer import Describer, PassingDescriptors
from everplace.describe.files.descriptors import Settings
from everplace.describe.recorded_frames import RecordedFrames, is_recording
from everplace.describe.reduced import reduced
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, MethodError
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse

__all__ = ["ClusterDescriber", "open_with", "seen_by_all"]

T = TypeVar("T")
R = TypeVar("R")
_BATCHES = 8
"""Batches of a block: what it costs to hand one over is little beside it, and a worker that dies loses little."""
_FILES_ALONE = (
    '`engine` "ray" describes directories of images; leave it out, or make the recording one first (everplace data '
    "import)"
)


class ClusterDescriber(Describer):
    """Describes as a method does, on a cluster.

    Every worker opens the method itself, and reads the images itself: run directory and images must lie where all
    machines see them under one path.
    """

    def __init__(self, method: str | os.PathLike[str], *, for_maps: bool = False, progress: Progress = quiet) -> None:
        """Opens the method here too, as what it may have to download is then there.

        Args:
            method: As `open_describer` takes it; a run directory is named to workers by its whole path.
            for_maps: Whether it is reduced as maps do it.
            progress: Told of downloads.

        Raises:
            MissingExtraError: Ray is not installed.
            MethodError: There is no such method, or it cannot run here.
            CheckpointError: The run directory is damaged.
        """
        require_ray()
        name = os.fspath(method)
        self._open = partial(_opened, str(Path(name).absolute()) if Path(name).is_dir() else name, for_maps)
        self.plain = self._open(progress=progress)
        self.method, self.image, self.dimension = self.plain.method, self.plain.image, self.plain.dimension
        self.metric, self.batch = self.plain.metric, self.plain.batch

    def settings(self) -> Settings:
        """Those of the method."""
        return self.plain.settings()

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes images that are in memory here."""
        return self.plain.describe_batch(images)

    def map_blocks(self, work: Callable[[Describer, T], R], blocks: Iterable[T]) -> Iterator[R]:
        """As `Describer.map_blocks`, on the cluster."""
        return map_on_cluster(partial(_prepared, self._open, dict(self.settings()), work), blocks)

    def describe_passing(
        self,
        images: Traverse | RecordedFrames | NDArray[np.uint8] | Sequence[NDArray[np.uint8]],
        *,
        batch: int | None = None,
        progress: Progress = quiet,
    ) -> PassingDescriptors:
        """As `Describer.describe_passing`, of traverses alone.

        Raises:
            ConfigError: `images` is a recording, which is decoded from its start on, or lies in memory.
            RouteError: There are no images.
        """
        if not isinstance(images, Traverse):
            raise ConfigError(_FILES_ALONE)
        return super().describe_passing(replace(images, root=images.root.absolute()), batch=batch, progress=progress)

    def rows_of_files(self, paths: Sequence[Path], batch: int) -> Iterator[NDArray[np.float32]]:
        """As `Describer.rows_of_files`, on the cluster."""
        size = batch * _BATCHES
        blocks = [paths[start : start + size] for start in range(0, len(paths), size)]
        return chain.from_iterable(self.map_blocks(partial(_described, batch=batch), blocks))


def open_with(engine: Engine, method: str, progress: Progress = quiet, *, for_maps: bool = False) -> Describer:
    """Opens a method as `open_describer` does, to describe here or on a cluster; `for_maps` as `ClusterDescriber`."""
    if engine == "ray":
        return ClusterDescriber(method, for_maps=for_maps, progress=progress)
    return _opened(method, for_maps, progress)


def seen_by_all(source: Traverse | str | os.PathLike[str]) -> Traverse | Path:
    """A drive under the path that it has on all machines of a cluster.

    Raises:
        ConfigError: It is a recording.
    """
    if isinstance(source, Traverse):
        return replace(source, root=source.root.absolute())
    if is_recording(Path(source)):
        raise ConfigError(_FILES_ALONE)
    return Path(source).absolute()


def _opened(method: str, for_maps: bool, progress: Progress = quiet) -> Describer:
    describer = open_describer(method, progress=progress)
    return reduced(describer) if for_maps else describer


def _prepared(
    open_method: Callable[[], Describer], settings: Settings, work: Callable[[Describer, T], R]
) -> Callable[[T], R]:
    """Opens the method in a worker."""
    describer = open_method()
    if dict(describer.settings()) != dict(settings):
        raise MethodError(
            f"{describer.method} has other settings on a machine of the cluster than here (other weights, or another "
            "version); install the same on all"
        )
    return partial(work, describer)


def _described(describer: Describer, paths: Sequence[Path], batch: int) -> NDArray[np.float32]:
    """N×D of image files, in the batches in which one machine describes them."""
    return np.stack(list(describer.rows_of_files(paths, batch)))
