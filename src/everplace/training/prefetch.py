"""Batches made ahead of the training step, for devices that compute while the processor waits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from everplace.images.decoding import map_ahead
from everplace.training.frames import Batch, EpochOrder, TrainingFrames

__all__ = ["BatchesAhead"]


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
            threads: None: one for each usable core, at most 8. Two batches a thread are held ahead.
        """
        self.sampler = order
        self._frames = frames
        self._pin = pin
        self._threads = threads

    def __len__(self) -> int:
        """Number of batches in an epoch."""
        return len(self.sampler)

    def __iter__(self) -> Iterator[Batch]:
        """Yields the batches; what making one raises is raised in its turn."""
        return map_ahead(self._batch, self.sampler, threads=self._threads)

    def _batch(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        batch = self._frames[key]
        return Batch(*(part.pin_memory() for part in batch)) if self._pin else batch
