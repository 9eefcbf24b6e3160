"""Runs a method over many images: threads decode ahead while the method describes.

Memory holds the descriptors, two batches of images, what the method needs for one batch and the decoder's own small
look-ahead, however long the traverse is.
"""

from __future__ import annotations

import contextlib
import operator
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer, LargeDescriber, ProbabilisticDescriber
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, DescriptorsError, RouteError
from everplace.images.decoding import decode_images
from everplace.progress import Progress, quiet
from everplace.route.route import Traverse

__all__ = ["describe_paths", "describe_traverse", "time_describer"]

_BATCH = 32


def describe_traverse(
    describer: Describer,
    traverse: Traverse,
    *,
    batch: int | None = None,
    threads: int | None = None,
    progress: Progress = quiet,
) -> Descriptors:
    """Describes all frames of a traverse, named by their stems and with their image names; see `describe_paths`."""
    described = describe_paths(
        describer, traverse.paths, traverse.stems, batch=batch, threads=threads, progress=progress
    )
    image_names = tuple(map(operator.add, traverse.stems, traverse.endings))
    return replace(described, image_names=image_names)


def describe_paths(
    describer: Describer,
    paths: Sequence[Path],
    names: Sequence[str],
    *,
    batch: int | None = None,
    threads: int | None = None,
    progress: Progress = quiet,
) -> Descriptors:
    """Describes image files, in their order.

    Args:
        describer: The method.
        paths: N image files.
        names: N names, one a file.
        batch: Largest number of images described at once; it changes speed and memory, not the result. None: what a
            large method asks for, else 32.
        threads: Number of decoding threads; None lets the decoder choose.
        progress: Shows how many frames are described.

    Raises:
        ConfigError: `batch` is below 1.
        RouteError: There are no images.
        ImageError: An image cannot be decoded; the message names it, and nothing is returned.
        DescriptorsError: The method returned numbers that are not finite, or not one row an image.
    """
    if not paths:
        raise RouteError("there are no images to describe; choose a directory or frames that hold some")
    if batch is None:
        batch = describer.batch if isinstance(describer, LargeDescriber) else _BATCH
    if batch < 1:
        raise ConfigError(f"a batch of {batch} images is not possible; give at least 1")
    if len(paths) != len(names):
        raise DescriptorsError(f"there are {len(paths)} images for {len(names)} names")
    values = np.empty((len(paths), describer.dimension), np.float32)
    variance = np.empty_like(values) if isinstance(describer, ProbabilisticDescriber) else None
    rows = _described(describer, paths, batch, threads)
    for index, (row, row_variance) in enumerate(progress(rows, "describing", len(paths))):
        values[index] = row
        if variance is not None and row_variance is not None:
            variance[index] = row_variance
    return Descriptors(values, tuple(names), describer.method, describer.metric, describer.settings(), variance)


def time_describer(describer: Describer, paths: Sequence[Path], *, frames: int = 32) -> float:
    """Measures how long a method takes for one image as it comes from a camera, alone.

    Args:
        describer: The method, opened; neither that nor decoding is counted.
        paths: Images to choose from; the first `frames` are used.
        frames: Number of images to time.

    Returns:
        The median over the images, in milliseconds.

    Raises:
        RouteError: There are no images.
        ImageError: An image cannot be decoded.
    """
    images = list(decode_images(paths[:frames], describer.image))
    if not images:
        raise RouteError("there are no images to time a method on; choose a directory or frames that hold some")
    describer.describe(images[0][None])  # the first call also allocates and chooses kernels
    elapsed = []
    for image in images:
        start = time.perf_counter()
        describer.describe(image[None])
        elapsed.append(time.perf_counter() - start)
    return 1000 * float(np.median(elapsed))


def _described(
    describer: Describer, paths: Sequence[Path], batch: int, threads: int | None
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32] | None]]:
    """Yields the descriptor of every image and its variance, while a thread gathers the next batch."""
    images = decode_images(paths, describer.image, threads=threads)
    with (
        contextlib.closing(_batches(images, batch)) as batches,
        ThreadPoolExecutor(1, "everplace-gather") as gather,
    ):
        upcoming = gather.submit(next, batches, None)
        while (current := upcoming.result()) is not None:
            upcoming = gather.submit(next, batches, None)
            yield from _rows(describer, current)


def _rows(
    describer: Describer, images: NDArray[np.uint8]
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32] | None]]:
    variance: NDArray[np.float32] | None = None
    if isinstance(describer, ProbabilisticDescriber):
        values, variance = describer.describe_with_variance(images)
    else:
        values = describer.describe(images)
    wanted = (len(images), describer.dimension)
    for array in (values, values if variance is None else variance):
        if array.shape != wanted:
            raise DescriptorsError(f"{describer.method} returned an array of shape {array.shape}, not {wanted}")
    for index, row in enumerate(values):
        yield row, None if variance is None else variance[index]


def _batches(images: Iterator[NDArray[np.uint8]], size: int) -> Generator[NDArray[np.uint8], None, None]:
    """Stacks up to `size` images in a row; an image of another shape (a spec without size) starts anew."""
    gathered: list[NDArray[np.uint8]] = []
    for image in images:
        if gathered and (len(gathered) == size or image.shape != gathered[0].shape):
            yield np.stack(gathered)
            gathered.clear()
        gathered.append(image)
    if gathered:
        yield np.stack(gathered)
