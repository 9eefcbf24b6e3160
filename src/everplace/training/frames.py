"""The training frames: packed pixels with their labels, the held-out block, and the order of an epoch."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from everplace.errors import RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec
from everplace.progress import Progress, quiet
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.route.traverse import Traverse
from everplace.training.augment import Augmentation, augment, augmentation_rng
from everplace.training.config import TrainConfig

__all__ = [
    "Batch",
    "EpochOrder",
    "FrameBlock",
    "SplitRoute",
    "TrainingFrames",
    "fingerprint",
    "require_enough_frames",
    "split_route",
]

_FRAMES_A_BLOCK = 256


class Batch(NamedTuple):
    """One step's frames.

    Attributes:
        images: (B, H, W, C) uint8.
        conditions: (B,) index of the condition.
        places: (B,) index of the training place, -1 where traverses are not aligned.
    """

    images: Tensor
    conditions: Tensor
    places: Tensor


@dataclass(frozen=True, eq=False)
class FrameBlock:
    """Frames of one traverse: pixels N×H×W×C, the index of their condition, and their N stems."""

    pixels: NDArray[np.uint8]
    condition: int
    stems: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SplitRoute:
    """What the gradient sees and what chooses the epoch.

    Attributes:
        conditions: Names of the conditions.
        training: One block a traverse.
        held_out: One block a traverse, a contiguous part at the end behind a gap; aligned if the route is.
        aligned: Row i of every block shows the same place.
    """

    conditions: tuple[str, ...]
    training: tuple[FrameBlock, ...]
    held_out: tuple[FrameBlock, ...]
    aligned: bool

    @property
    def places(self) -> int:
        """Number of training places; 0 if the traverses are not aligned."""
        return len(self.training[0].pixels) if self.aligned else 0

    @property
    def trained_stems(self) -> tuple[str, ...]:
        """Stems of the frames in the gradient, each once."""
        return tuple(dict.fromkeys(stem for block in self.training for stem in block.stems))

    @property
    def held_out_stems(self) -> tuple[str, ...]:
        """Stems of the frames that choose the epoch, each once."""
        return tuple(dict.fromkeys(stem for block in self.held_out for stem in block.stems))


def split_route(route: Route, config: TrainConfig, progress: Progress = quiet) -> SplitRoute:
    """Packs the chosen frames and keeps a contiguous block at the end out of the gradient.

    Args:
        route: The chosen traverses, after selection.
        config: Image size, held-out fraction and gap.
        progress: Told of the packing.

    Raises:
        RouteError: There are too few frames to hold a block out.
    """
    spec = ImageSpec(config.image_size, config.grey)
    conditions = route.conditions
    training: list[FrameBlock] = []
    held_out: list[FrameBlock] = []
    for traverse in route.traverses:
        parts = _parts(traverse, config)
        packed = pack(traverse, spec, progress=progress)
        condition = conditions.index(traverse.condition)
        for blocks, part in zip((training, held_out), parts, strict=True):
            blocks.append(FrameBlock(packed.pixels[part], condition, packed.stems[part]))
    return SplitRoute(conditions, tuple(training), tuple(held_out), route.aligned)


def require_enough_frames(route: Route, config: TrainConfig) -> None:
    """Makes sure that a block can be held out of every traverse, before any frame is decoded.

    Raises:
        RouteError: A traverse has too few frames.
    """
    for traverse in route.traverses:
        _parts(traverse, config)


def _parts(traverse: Traverse, config: TrainConfig) -> tuple[slice, slice]:
    """Which frames of a traverse the gradient sees, and which choose the epoch."""
    total = len(traverse)
    kept_out = max(2, round(config.held_out * total))
    end = total - kept_out - config.held_out_gap
    if end < 2:
        raise RouteError(
            f"traverse {readable(traverse.name)} has {total} frames to train on, too few to hold out {kept_out} "
            f"behind a gap of {config.held_out_gap}; add frames or set held_out and held_out_gap lower"
        )
    return slice(end), slice(total - kept_out, total)


def fingerprint(split: SplitRoute, progress: Progress = quiet) -> str:
    """SHA-256, in hex, of all images and labels that training and the choice of the epoch see.

    Wherever the route lies and whatever its traverses are called, the same images give the same fingerprint.
    """
    blocks = (*split.training, *split.held_out)
    labels = [(block.condition, block.pixels.shape, block.stems) for block in blocks]
    digest = hashlib.sha256(json.dumps([split.conditions, split.aligned, len(split.training), labels]).encode())
    parts = [(block, start) for block in blocks for start in range(0, len(block.pixels), _FRAMES_A_BLOCK)]
    for block, start in progress(parts, "fingerprint of the images", len(parts)):
        digest.update(np.ascontiguousarray(block.pixels[start : start + _FRAMES_A_BLOCK]).data)
    return digest.hexdigest()


class TrainingFrames(Dataset[Batch]):
    """Gives whole batches, augmented; a key is an epoch with the positions of its frames."""

    def __init__(self, split: SplitRoute, augmentation: Augmentation, seed: int) -> None:
        self._blocks = split.training
        self._starts = np.cumsum([0, *(len(block.pixels) for block in self._blocks)])
        self._aligned = split.aligned
        self._augmentation = augmentation
        self._seed = seed

    def __len__(self) -> int:
        """Number of frames."""
        return int(self._starts[-1])

    def __getitem__(self, key: tuple[int, NDArray[np.int64]]) -> Batch:
        """Returns the frames at the key's positions, augmented as (seed, epoch, position) says."""
        epoch, positions = key
        pixels, conditions, places = self._read(positions)
        images = [
            augment(image, self._augmentation, augmentation_rng(self._seed, epoch, int(position)))
            for image, position in zip(pixels, positions, strict=True)
        ]
        return Batch(torch.from_numpy(np.stack(images)), torch.from_numpy(conditions), torch.from_numpy(places))

    def _read(self, positions: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
        """Returns pixels B×H×W×C, conditions (B,) and places (B,) as they are stored."""
        blocks = np.searchsorted(self._starts, positions, side="right") - 1
        rows = positions - self._starts[blocks]
        pixels = np.stack([self._blocks[block].pixels[row] for block, row in zip(blocks, rows, strict=True)])
        conditions = np.array([self._blocks[block].condition for block in blocks], dtype=np.int64)
        return pixels, conditions, rows if self._aligned else np.full_like(rows, -1)


class EpochOrder(Sampler[tuple[int, NDArray[np.int64]]]):
    """The batches of each epoch, a function of (seed, epoch) alone, so that a resumed run sees the same ones.

    With several devices each takes every `world`-th item of a batch, so the batches do not depend on their number.
    The items of the last, smaller batch wait for the next epoch's order. An item is a frame, or a pair of frames.
    """

    def __init__(self, items: int, batch: int, seed: int, *, first_epoch: int = 0) -> None:
        self._items = items
        self._batch = min(batch, items)
        self._seed = seed
        self._first = first_epoch
        self._epoch = first_epoch
        self._rank, self._world = 0, 1

    @property
    def batch(self) -> int:
        """Number of items in a batch, over all devices."""
        return self._batch

    def share(self, rank: int, world: int) -> None:
        """Says which part of each batch this device takes."""
        self._rank, self._world = rank, world

    def set_epoch(self, epoch: int) -> None:
        """Lightning calls this with the epoch counted from the start of this process."""
        self._epoch = self._first + epoch

    def __len__(self) -> int:
        """Number of batches in an epoch."""
        return self._items // self._batch

    def __iter__(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yields the epoch with the positions of one batch's frames."""
        order = self._draw(np.random.default_rng((self._seed, self._epoch)))
        for start in range(0, len(self) * self._batch, self._batch):
            yield self._epoch, order[start : start + self._batch][self._rank :: self._world]

    def _draw(self, rng: np.random.Generator) -> NDArray[np.int64]:
        """Returns the positions of all items in a new order."""
        return rng.permutation(self._items)
