"""The training frames: packed pixels with their labels, the held-out block, and the order of an epoch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from everplace.errors import ConfigError, RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec
from everplace.progress import Progress, quiet
from everplace.route.fingerprint import fingerprint
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.route.traverse import Traverse
from everplace.threads import map_ahead
from everplace.training.augment import Augmentation, augment, augmentation_rng
from everplace.training.config import TrainConfig

__all__ = [
    "Batch",
    "FrameBlock",
    "SplitRoute",
    "TrainingFrames",
    "images_fingerprint",
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

    def map(self, function: Callable[[Tensor], Tensor]) -> Batch:
        """The same batch with every tensor changed."""
        return Batch(*map(function, self))


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


def images_fingerprint(split: SplitRoute, progress: Progress = quiet) -> str:
    """SHA-256, in hex, of all images and labels that training and the choice of the epoch see.

    Wherever the route lies and whatever its traverses are called, the same images give the same fingerprint.
    """
    blocks = (*split.training, *split.held_out)
    labels = [(block.condition, block.pixels.shape, block.stems) for block in blocks]
    parts = [(block, start) for block in blocks for start in range(0, len(block.pixels), _FRAMES_A_BLOCK)]
    pixels = (
        np.ascontiguousarray(block.pixels[start : start + _FRAMES_A_BLOCK]).data
        for block, start in progress(parts, "fingerprint of the images", len(parts))
    )
    return fingerprint([split.conditions, split.aligned, len(split.training), labels], pixels)


class TrainingFrames:
    """The batches of each epoch: which frames, in which order, how changed is a function of (seed, epoch) alone.

    So a resumed run sees the same ones. With several devices each takes every `world`-th frame of a batch, so the
    batches do not depend on their number. The frames of the last, smaller batch wait for the next epoch's order.
    """

    def __init__(self, split: SplitRoute, augmentation: Augmentation, batch_size: int, seed: int) -> None:
        self._blocks = split.training
        self._starts = np.cumsum([0, *(len(block.pixels) for block in self._blocks)])
        self._aligned = split.aligned
        self._augmentation = augmentation
        self._seed = seed
        self.frames = int(self._starts[-1])
        self.batch_size = min(batch_size, self.frames)

    def __len__(self) -> int:
        """Number of batches in an epoch."""
        return self.frames // self.batch_size

    def order(self, epoch: int, rank: int = 0, world: int = 1) -> Iterator[NDArray[np.int64]]:
        """Yields the positions of the frames of each batch, of which device `rank` of `world` takes its part."""
        order = np.random.default_rng((self._seed, epoch)).permutation(self.frames)
        for start in range(0, len(self) * self.batch_size, self.batch_size):
            yield order[start : start + self.batch_size][rank::world]

    def batches(self, epoch: int, rank: int, world: int, device: torch.device) -> Iterator[Batch]:
        """Yields the part of device `rank` of `world` of the batches of an epoch, on the device.

        On the CPU the network uses all cores itself. A CUDA device leaves the processor free: threads augment batches
        ahead, in memory that the device reads from without waiting. (OpenCV lets go of the interpreter's lock; worker
        processes would be forked from a process that holds threads, which may hang, or import torch anew.)
        """
        order = self.order(epoch, rank, world)
        if device.type != "cuda":
            yield from (self.batch(epoch, positions) for positions in order)
            return
        for batch in map_ahead(lambda positions: self.batch(epoch, positions).map(Tensor.pin_memory), order):
            yield batch.map(lambda part: part.to(device, non_blocking=True))

    def batch(self, epoch: int, positions: NDArray[np.int64]) -> Batch:
        """Returns the frames at some positions, augmented as (seed, epoch, position) says."""
        blocks = np.searchsorted(self._starts, positions, side="right") - 1
        rows = positions - self._starts[blocks]
        images = [
            augment(
                self._blocks[block].pixels[row],
                self._augmentation,
                augmentation_rng(self._seed, epoch, int(position)),
            )
            for block, row, position in zip(blocks, rows, positions, strict=True)
        ]
        conditions = np.array([self._blocks[block].condition for block in blocks], dtype=np.int64)
        places = rows if self._aligned else np.full_like(rows, -1)
        return Batch(torch.from_numpy(np.stack(images)), torch.from_numpy(conditions), torch.from_numpy(places))

    def require_frames_per_device(self, devices: int) -> None:
        """Refuses batches of which a device would get too little to learn from.

        Args:
            devices: On all machines together.

        Raises:
            ConfigError: A device would have fewer than two frames.
        """
        # Batch normalisation needs two frames wherever it runs.
        if self.batch_size < 2 * devices:
            raise ConfigError(
                f"a batch of {self.batch_size} frames is too small for {devices} devices, which need two each; "
                "raise batch_size, add frames or give fewer `devices`"
            )
