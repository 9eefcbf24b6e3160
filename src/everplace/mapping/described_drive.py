"""A drive's frames described for a map, as they are read: features, pictures, and what other light changes."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from everplace.adaptation.drive_statistics import half_differences
from everplace.adaptation.moments import Moments
from everplace.adaptation.other_light import CHANGES, changed
from everplace.describe.describer import Describer
from everplace.errors import DescriptorsError, RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec, convert_image
from everplace.importing.foreign_route import ForeignFrame
from everplace.importing.frame_pixels import decode_content
from everplace.mapping.drive_source import DriveFrames
from everplace.mapping.image_statistics import image_statistics
from everplace.progress import Progress, quiet
from everplace.route.traverse import Pose

__all__ = ["DescribedDrive", "describe_drive", "how_it_looks", "light_moments", "thumbnail"]

_LIGHT_FRAMES = 1024
"""From so many frames on only every second one is looked at in other light, then every fourth, and so on."""
_THUMBNAIL = 160
_QUALITY = 80
_COLOUR = ImageSpec()
_LOOKED_AT = ImageSpec((64, 128))


@dataclass(frozen=True, eq=False)
class DescribedDrive:
    """N frames of one drive.

    Attributes:
        stems: Their names.
        features: N×F float16, what the map's method says of them.
        looks: N×32, how they look (`everplace.mapping.image_statistics`).
        poses: N×3 (x, y in metres, heading in radians), NaN where unknown.
        seconds: (N,) when each was taken, NaN where unknown.
        thumbnails: JPEG files.
        light: What other light changes in the features, of at most 1,023 frames; None: not looked at.
    """

    stems: tuple[str, ...]
    features: NDArray[np.float16]
    looks: NDArray[np.float32]
    poses: NDArray[np.float64]
    seconds: NDArray[np.float64]
    thumbnails: tuple[bytes, ...]
    light: Moments | None

    def __len__(self) -> int:
        """Returns the number of frames."""
        return len(self.stems)


def describe_drive(
    drive: DriveFrames, describer: Describer, progress: Progress = quiet, *, in_other_light: bool
) -> DescribedDrive:
    """Reads and describes a drive; memory holds features and thumbnails, and the images of one batch.

    Args:
        drive: Its frames.
        describer: The map's method.
        progress: Told of the frames.
        in_other_light: Whether to see what other light changes in them.

    Raises:
        RouteError: There is no frame.
        ImageError: A frame cannot be decoded.
        DescriptorsError: The method gives a number that 16 bits do not hold.
    """
    stems, poses, seconds, thumbnails = [], [], [], []
    features: list[NDArray[np.float16]] = []
    looks: list[NDArray[np.float32]] = []
    kept = _Thinned(_LIGHT_FRAMES)
    parts = describer.map_blocks(partial(_described, keep=in_other_light), _batches(drive.frames, describer.batch))
    for frame in progress(chain.from_iterable(parts), f"describing {drive.name}", drive.count):
        stems.append(frame.stem)
        poses.append(frame.pose or (np.nan,) * 3)
        seconds.append(np.nan if frame.seconds is None else frame.seconds)
        thumbnails.append(frame.thumbnail)
        looks.append(frame.looks)
        if not np.isfinite(frame.features).all():
            raise DescriptorsError(
                f"{describer.method} gives numbers that are not finite, or beyond 65,504, of {readable(drive.name)}; a "
                "map keeps them in 16 bits: choose another method"
            )
        features.append(frame.features)
        if frame.image is not None:
            kept.add(frame.image)
    if not stems:
        raise RouteError(f"the drive {drive.name!r} holds no frame; give another")
    light = light_moments(kept.items, describer, progress) if in_other_light else None
    return DescribedDrive(
        tuple(stems),
        np.stack(features),
        np.stack(looks),
        np.array(poses, float),
        np.array(seconds, float),
        tuple(thumbnails),
        light,
    )


class _DescribedFrame(NamedTuple):
    """What is kept of a frame, and its image where it may be looked at in other light."""

    stem: str
    pose: Pose | None
    seconds: float | None
    thumbnail: bytes
    looks: NDArray[np.float32]
    features: NDArray[np.float16]
    image: NDArray[np.uint8] | None


def _described(describer: Describer, frames: Sequence[ForeignFrame], *, keep: bool) -> list[_DescribedFrame]:
    """Reads and describes one batch."""
    thumbnails, looks, images = [], [], []
    for frame in frames:
        whole = decode_content(frame, _COLOUR)
        thumbnails.append(thumbnail(whole))
        looks.append(how_it_looks(whole))
        images.append(convert_image(whole, describer.image))
    with np.errstate(over="ignore"):  # which is looked for
        halves = describer.describe_batch(np.stack(images)).astype(np.float16)
    return [
        _DescribedFrame(frame.stem, frame.pose, frame.seconds, small, look, row, image if keep else None)
        for frame, small, look, row, image in zip(frames, thumbnails, looks, halves, images, strict=True)
    ]


def how_it_looks(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(32,) of an image of any size, grey or RGB; see `everplace.mapping.image_statistics`."""
    looks: NDArray[np.float32] = image_statistics(convert_image(image, _LOOKED_AT)[None])[0]
    return looks


def thumbnail(image: NDArray[np.uint8]) -> bytes:
    """A small JPEG file of H×W×3 RGB pixels."""
    width = min(_THUMBNAIL, image.shape[1])
    size = (width, max(1, round(image.shape[0] * width / image.shape[1])))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()


class _Thinned:
    """Fewer items than some number, evenly spread over a stream of unknown length."""

    def __init__(self, fewer_than: int) -> None:
        self.items: list[NDArray[np.uint8]] = []
        self._fewer_than, self._stride, self._seen = fewer_than, 1, 0

    def add(self, image: NDArray[np.uint8]) -> None:
        if self._seen % self._stride == 0:
            self.items.append(image)
        self._seen += 1
        if len(self.items) == self._fewer_than:
            self.items = self.items[::2]
            self._stride *= 2


def light_moments(images: Sequence[NDArray[np.uint8]], describer: Describer, progress: Progress = quiet) -> Moments:
    """What other light, weather and a camera turned a little change in a descriptor of some images.

    Args:
        images: As `describer.image` says.
        describer: Gives the features.
        progress: Told of the batches.
    """
    changes = np.empty((len(images), len(CHANGES), describer.dimension), np.float32)
    starts = range(0, len(images), describer.batch)
    for start in progress(starts, "in other light", len(starts)):
        batch = np.stack(images[start : start + describer.batch])
        before = describer.describe_batch(batch)
        for number, other in enumerate(changed(batch, start)):
            changes[start : start + len(batch), number] = half_differences(describer.describe_batch(other), before)
    return Moments.of(changes.reshape(-1, describer.dimension))


def _batches(frames: Iterable[ForeignFrame], size: int) -> Iterator[list[ForeignFrame]]:
    iterator = iter(frames)
    while batch := list(itertools.islice(iterator, size)):
        yield batch
