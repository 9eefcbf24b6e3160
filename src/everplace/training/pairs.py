"""Batches of single frames, or of pairs for the remedies that need them: two frames of a place, of two traverses."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from everplace.errors import ConfigError, RouteError
from everplace.training.augment import Augmentation, augment, augmentation_rng
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch, EpochOrder, SplitRoute, TrainingFrames
from everplace.training.sections import Remedies
from everplace.training.virtual_places import VirtualPlaces, virtual_pairs

__all__ = ["PairOrder", "PairedFrames", "make_frames", "make_order", "require_shares"]

_NO_MOVE = {"shift": 0.0, "crop": 0.0}
_NO_LIGHT = {"brightness": 0.0, "contrast": 0.0, "blur": 0.0}


class PairedFrames(TrainingFrames):
    """Gives whole batches; a key is an epoch with P×2 positions. The two frames of a place follow each other."""

    def __init__(
        self, split: SplitRoute, augmentation: Augmentation, virtual: VirtualPlaces, seed: int, *, alike: bool = False
    ) -> None:
        """Makes the pairs of a route.

        Args:
            split: At least two aligned traverses.
            augmentation: How much images are changed.
            virtual: How much places are changed.
            seed: Of all that is random.
            alike: Shift and crop the two frames of a place alike, so that each can be decoded from the other's z_p.
        """
        super().__init__(split, augmentation, seed)
        self._virtual = virtual
        self._alike = alike

    def __getitem__(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        """Returns the 2P frames, augmented as (seed, epoch, position) says.

        What is joined to what depends on the batch, and so on the number of devices that share one.
        """
        epoch, pairs = key
        positions = pairs.ravel()
        pixels, conditions, places = self._read(positions)
        rng = np.random.default_rng((self._seed, epoch, int(positions[0])))
        changed = virtual_pairs(pixels.reshape(*pairs.shape, *pixels.shape[1:]), self._virtual, rng)
        leading = np.repeat(pairs[:, 0], 2)
        images = [
            self._augment(image, epoch, int(position), int(first))
            for image, position, first in zip(changed.reshape(pixels.shape), positions, leading, strict=True)
        ]
        return Batch(torch.from_numpy(np.stack(images)), torch.from_numpy(conditions), torch.from_numpy(places))

    def _augment(self, image: NDArray[np.uint8], epoch: int, position: int, first: int) -> NDArray[np.uint8]:
        """Changes a frame as its own position says; alike: moves it as the position of its pair's first frame says."""
        own = self._augmentation
        if self._alike:
            image = augment(image, own.model_copy(update=_NO_LIGHT), augmentation_rng(self._seed, epoch, first))
            own = own.model_copy(update=_NO_MOVE)
        return augment(image, own, augmentation_rng(self._seed, epoch, position))


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


def make_frames(split: SplitRoute, config: TrainConfig) -> TrainingFrames:
    """The training frames as a configuration wants them: one by one, or in pairs."""
    remedies = config.remedies
    if not remedies.need_pairs:
        return TrainingFrames(split, config.augmentation, config.seed)
    # A frame that is decoded from the other's z_p must be moved as the other is.
    alike = bool(remedies.swap)
    return PairedFrames(split, config.augmentation, remedies.virtual, config.seed, alike=alike)


def make_order(split: SplitRoute, config: TrainConfig, first_epoch: int) -> EpochOrder:
    """The order of those frames or pairs.

    Raises:
        RouteError: There are to be pairs, and there is one traverse.
    """
    traverses = len(split.training)
    if not config.remedies.need_pairs:
        frames = sum(len(block.pixels) for block in split.training)
        return EpochOrder(frames, config.batch_size, config.seed, first_epoch=first_epoch)
    if traverses < 2:
        named = "contrastive" if config.remedies.contrastive else "swap"
        raise RouteError(f"remedies.{named} needs two traverses of the same places, and there is one; add another")
    return PairOrder(split.places, traverses, config.batch_size, config.seed, first_epoch=first_epoch)


def require_shares(split: SplitRoute, config: TrainConfig, devices: int) -> None:
    """Refuses batches of which a device would get too little to learn from.

    Args:
        split: The route.
        config: Its batch size and remedies.
        devices: On all machines together.

    Raises:
        ConfigError: A device would have fewer than two frames; or no pair, where the remedies need pairs; or one pair,
            where they need two places. The message names the remedy.
        RouteError: As `make_order`.
    """
    batch = make_order(split, config, 0).batch
    if not config.remedies.need_pairs:
        # Batch normalisation needs two frames wherever it runs.
        if batch < 2 * devices:
            raise ConfigError(
                f"a batch of {batch} frames is too small for {devices} devices, which need two each; "
                "raise batch_size, add frames or give fewer --devices"
            )
        return
    remedy, needed = _pairs_needed(config.remedies)
    enough = 2 * needed * devices
    if batch < needed * devices:
        way = f"set batch_size to {enough} or more" if config.batch_size < enough else "add frames"
        fewer = " or give fewer --devices" if devices > 1 else ""
        raise ConfigError(
            f"a batch of {_counted(batch, 'pair')} of frames (batch_size = {config.batch_size}) is too small for "
            f"{_counted(devices, 'device')} with {remedy}, which needs {_counted(needed, 'pair')} on each; {way}{fewer}"
        )


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _pairs_needed(remedies: Remedies) -> tuple[str, int]:
    """The remedy that needs most pairs on a device, and how many."""
    # Both would be 0 without a second place.
    if remedies.contrastive:
        return "remedies.contrastive", 2
    if remedies.swap_z_c == "other_place":
        return 'remedies.swap_z_c = "other_place"', 2
    return "remedies.swap", 1
