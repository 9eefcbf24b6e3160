"""The base class of every method that describes images."""

from __future__ import annotations

import contextlib
import operator
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from everplace.describe.batches import gather_batches
from everplace.describe.files.descriptors import Descriptors, Metric, Settings
from everplace.describe.recorded_frames import RecordedFrames
from everplace.errors import ConfigError, DescriptorsError, MethodError, RouteError
from everplace.files import readable
from everplace.images.decoding import ImageSpec, convert_image, decode_images
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse

if TYPE_CHECKING:
    from torch import nn

    from everplace.model.checkpoint import Checkpoint
    from everplace.model.condition_vae import ConditionVAE

__all__ = ["Describer", "require_no_argument"]

# Networks round an image's descriptor differently at different places of a batch.
_ROUNDING = 1e-5


class Describer(ABC):
    """A method, opened and ready.

    A new method sets `method`, `image` and `dimension` and defines `settings` and `describe_batch`. The values that the
    other attributes have here suit most methods.

    Attributes:
        method: The name under which its descriptors are known; only descriptors of one method are compared.
        image: What its images must be: size, grey or colour.
        dimension: D, the number of values of one descriptor.
        metric: How two of its descriptors are compared.
        batch: Images described at once where nobody asks for another number; fewer for a large network.
        seen_stems: Stems of the frames that it was fitted on or chosen by, which are no test of it.
        seen_images: The images of these places, told by `everplace.route.fingerprint.image_digests`; empty where that
            was not recorded.
        checkpoint: The trained network that it describes with, as the run directory holds it.
        latent_model: The same network where it is applied, if it has a latent to audit and to decode from.
    """

    method: str
    image: ImageSpec
    dimension: int
    metric: Metric = "cosine"
    batch: int = 32
    seen_stems: frozenset[str] = frozenset()
    seen_images: frozenset[str] = frozenset()
    checkpoint: Checkpoint | None = None
    latent_model: ConditionVAE | None = None

    @abstractmethod
    def settings(self) -> Settings:
        """Returns what changes the numbers, nothing else: only descriptors of equal settings are compared."""

    @abstractmethod
    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes images that are as `image` says; each row depends on its own image alone.

        Args:
            images: B×H×W×C (C = 1 grey, 3 RGB), values 0 to 255.

        Returns:
            B×D finite numbers.
        """

    def network(self) -> nn.Module | None:
        """The method as a torch network on the processor, for export; None: it is none.

        It takes B×C×H×W float32 images in [0, 1], as `image` says, and gives what `describe_batch` does.

        Raises:
            MethodError: It could be one, but not as it was put together.
        """
        return None

    def describe(
        self,
        images: Traverse | RecordedFrames | NDArray[np.uint8] | Sequence[NDArray[np.uint8]],
        *,
        batch: int | None = None,
        progress: Progress = quiet,
    ) -> Descriptors:
        """Describes the frames of a traverse or a recording, an image or several, of any size and in colour or grey.

        Memory holds the descriptors, two batches of images, what the method needs for one batch and the decoder's own
        small look-ahead, however long the traverse is.

        Args:
            images: Such as `route["winter"]`; a video or bag of `open_recording`; or one image H×W or H×W×3 (RGB),
                uint8, or a list of such.
            batch: Largest number of images described at once; it changes speed and memory, not the result. None: what
                the method asks for.
            progress: Shows how many images are described.

        Returns:
            N×D descriptors in the order of the images. Those of a traverse are named by the frames' stems and know
            the names of their files; those of a recording by the numbers of the frames; others "0", "1" and so on.

        Raises:
            ConfigError: `batch` is below 1.
            RouteError: There are no images, or the recording is damaged.
            ImageError: An image cannot be decoded, or an array is none; nothing is returned.
            DescriptorsError: The method returned numbers that are not finite, or not one row an image.

        Warns:
            UserWarning: Most descriptors of a traverse or recording are equal, so they cannot tell its frames apart.
        """
        batch = self.batch if batch is None else batch
        if batch < 1:
            raise ConfigError(f"a batch of {batch} images is not possible; give at least 1")
        if isinstance(images, RecordedFrames):
            return self._describe_recording(images, batch, progress)
        names: tuple[str, ...]
        image_names: tuple[str, ...] | None
        if isinstance(images, Traverse):
            names, image_names = images.stems, tuple(map(operator.add, images.stems, images.endings))
            decoded = decode_images(images.paths, self.image)
        else:
            arrays = [images] if isinstance(images, np.ndarray) else images
            names, image_names = tuple(map(str, range(len(arrays)))), None
            decoded = (convert_image(array, self.image) for array in arrays)
        if not names:
            raise RouteError("there are no images to describe; choose a directory or frames that hold some")
        values = np.empty((len(names), self.dimension), np.float32)
        for index, row in enumerate(progress(self._rows(decoded, batch), "describing", len(names))):
            values[index] = row
        described = Descriptors(values, names, self.method, self.metric, self.settings(), image_names)
        if isinstance(images, Traverse):
            _warn_of_equal(values, images.root)
        return described

    def _describe_recording(self, recording: RecordedFrames, batch: int, progress: Progress) -> Descriptors:
        names: list[str] = []
        rows = self._rows(recording.pixels(self.image, names), batch)
        values = np.stack(list(progress(rows, f"describing {recording.drive.name}", recording.drive.count)))
        _warn_of_equal(values, recording.path)
        return Descriptors(values, tuple(names), self.method, self.metric, self.settings())

    def _rows(self, images: Iterator[NDArray[np.uint8]], batch: int) -> Iterator[NDArray[np.float32]]:
        with contextlib.closing(gather_batches(images, batch)) as batches:
            for gathered in batches:
                values, wanted = self.describe_batch(gathered), (len(gathered), self.dimension)
                if values.shape != wanted:
                    raise DescriptorsError(f"{self.method} returned an array of shape {values.shape}, not {wanted}")
                yield from values


def _warn_of_equal(values: NDArray[np.float32], source: Path) -> None:
    """Warns where more than half of a drive's descriptors are equal but for rounding, such as all zero."""
    # Boyer and Moore's vote: if one row has a majority, it is the one that is left.
    common, votes = values[0], 0
    for row in values:
        if not votes:
            common = row
        votes += 1 if _equal(row, common) else -1
    if votes <= 0:
        return
    equal = sum(_equal(row, common) for row in values)
    if len(values) > 1 and 2 * equal > len(values):
        what = "equal" if common.any() else "zero"
        warnings.warn(
            f"{equal} of the {len(values)} descriptors of {readable(source)} are {what}, so no score tells "
            "these frames apart; look at the images with everplace data inspect: are they black, or all the same?",
            stacklevel=3,
        )


def _equal(row: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    return bool(np.abs(row - other).max() <= _ROUNDING * np.abs(other).max())


def require_no_argument(method: str, argument: str) -> None:
    """Raises MethodError if a method that has no options was given an argument."""
    if argument:
        raise MethodError(f"the method {method!r} takes no argument; write {method} instead of {method}:{argument}")
