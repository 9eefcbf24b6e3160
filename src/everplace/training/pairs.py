"""Batches of pairs for the contrastive remedy: two frames of each place, from different traverses."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.data.augment import Augmentation, augment, augmentation_rng
from everplace.data.virtual_places import VirtualPlaces, virtual_pairs
from everplace.training.frames import Batch, EpochOrder, SplitRoute, TrainingFrames

__all__ = ["PairOrder", "PairedFrames"]


class PairedFrames(TrainingFrames):
    """Gives whole batches; a key is an epoch with P×2 positions. The two frames of a place follow each other."""

    def __init__(self, split: SplitRoute, augmentation: Augmentation, virtual: VirtualPlaces, seed: int) -> None:
        super().__init__(split, augmentation, seed)
        self._virtual = virtual

    def __getitem__(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        """Returns the 2P frames, augmented as (seed, epoch, position) says.

        What is joined to what depends on the batch, and so on the number of devices that share one.
        """
        epoch, pairs = key
        positions = pairs.ravel()
        pixels, conditions, places = self._read(positions)
        rng = np.random.default_rng((self._seed, epoch, int(positions[0])))
        changed = virtual_pairs(pixels.reshape(*pairs.shape, *pixels.shape[1:]), self._virtual, rng)
        images = [
            augment(image, self._augmentation, augmentation_rng(self._seed, epoch, int(position)))
            for image, position in zip(changed.reshape(pixels.shape), positions, strict=True)
        ]
        return Batch(torch.from_numpy(np.stack(images)), torch.from_numpy(conditions), torch.from_numpy(places))


class PairOrder(EpochOrder):
    """The batches of each epoch as pairs: each place with as many pairs of its traverses as it has, drawn anew."""

    def __init__(self, places: int, traverses: int, batch_size: int, seed: int, *, first_epoch: int = 0) -> None:
        super().__init__(places * (traverses // 2), max(1, batch_size // 2), seed, first_epoch=first_epoch)
        self._places, self._traverses = places, traverses

    def _draw(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Returns pairs of positions, (places × traverses // 2, 2)."""
        drawn = rng.permuted(np.tile(np.arange(self._traverses), (self._places, 1)), axis=1)
        even = drawn[:, : self._traverses // 2 * 2] * self._places + np.arange(self._places)[:, None]
        return rng.permutation(even.reshape(-1, 2))
