"""Batches made ahead of the training step, for devices that compute while the processor waits."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from everplace.data.images import usable_cores
from everplace.training.frames import Batch, EpochOrder, TrainingFrames

__all__ = ["BatchesAhead"]

_MOST_THREADS = 8


class BatchesAhead:
    """The batches of an epoch, in their order, augmented by threads while the device computes.

    Threads suffice, since OpenCV lets go of the interpreter's lock, and they start at once. Worker processes would be
    forked from a process that holds threads, which may hang, or import torch anew.

    Attributes:
        sampler: The order; Lightning tells it the epoch.
    """

    def __init__(self, frames: TrainingFrames, order: EpochOrder, *, pin: bool, threads: int | None = None) -> None:
        """Takes what `torch.utils.data.DataLoader` would.

        Args:
            frames: Gives the batches by their keys.
            order: The keys of an epoch.
            pin: Batches lie in page-locked memory, from which a CUDA device reads without waiting.
            threads: None: one a core, at most eight.
        """
        self.sampler = order
        self._frames = frames
        self._pin = pin
        self._threads = threads or min(_MOST_THREADS, usable_cores())

    def __len__(self) -> int:
        """Number of batches in an epoch."""
        return len(self.sampler)

    def __iter__(self) -> Iterator[Batch]:
        """Yields the batches; at most two for each thread are in memory.

        Raises:
            Exception: Whatever a batch raised, in its turn.
        """
        pending: deque[Future[Batch]] = deque()
        with ThreadPoolExecutor(self._threads, "everplace-batches") as pool:
            try:
                for key in self.sampler:
                    pending.append(pool.submit(self._batch, key))
                    if len(pending) > 2 * self._threads - 1:
                        yield pending.popleft().result()
                while pending:
                    yield pending.popleft().result()
            finally:
                for batch in pending:
                    batch.cancel()

    def _batch(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        batch = self._frames[key]
        return Batch(*(part.pin_memory() for part in batch)) if self._pin else batch
