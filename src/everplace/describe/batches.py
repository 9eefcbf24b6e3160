"""Gathers images into batches: a thread fills the next one while the last is being described."""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

__all__ = ["gather_batches"]


def gather_batches(images: Iterator[NDArray[np.uint8]], size: int) -> Generator[NDArray[np.uint8], None, None]:
    """Stacks images in a row; an image of another shape (a spec without size) begins a new batch.

    Args:
        images: H×W×C each.
        size: Largest number in a batch.

    Yields:
        B×H×W×C; the next one is being gathered meanwhile.
    """
    with contextlib.closing(_stacked(images, size)) as batches, ThreadPoolExecutor(1, "everplace-gather") as gather:
        upcoming = gather.submit(next, batches, None)
        while (current := upcoming.result()) is not None:
            upcoming = gather.submit(next, batches, None)
            yield current


def _stacked(images: Iterator[NDArray[np.uint8]], size: int) -> Generator[NDArray[np.uint8], None, None]:
    gathered: list[NDArray[np.uint8]] = []
    for image in images:
        if gathered and (len(gathered) == size or image.shape != gathered[0].shape):
            yield np.stack(gathered)
            gathered.clear()
        gathered.append(image)
    if gathered:
        yield np.stack(gathered)
