"""The base class of every method that describes images."""

from __future__ import annotations

import contextlib
import operator
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from everplace.describe.batches import gather_batches
from everplace.describe.equal_descriptors import MajorityVote
from everplace.describe.files.descriptors import Descriptors, Metric, Settings
from everplace.describe.recorded_frames import RecordedFrames
from everplace.errors import ConfigError, DescriptorsError, MethodError, RouteError
from everplace.images.decoding import ImageSpec, convert_image, decode_images
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse

if TYPE_CHECKING:
    from torch import nn

    from everplace.model.checkpoint import Checkpoint
    from everplace.model.condition_vae import ConditionVAE

__all__ = ["Describer", "PassingDescriptors", "require_no_argument"]

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class PassingDescriptors:
    """Descriptors that are made one after the other while somebody reads them, once.

    Attributes:
        rows: (D,) each, in the order of the images.
        expected: How many there will be; of a recording an estimate, or None.
        names: Of the frames; of a recording whole once `rows` are read.
        image_names: Of the files of the frames, where there are files.
        source: The drive; None: images in memory.
    """

    rows: Iterator[NDArray[np.float32]]
    expected: int | None
    names: Sequence[str]
    image_names: tuple[str, ...] | None
    source: Path | None


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
        passing = self.describe_passing(images, batch=batch, progress=progress)
        values = np.empty((passing.expected or 1, self.dimension), np.float32)
        count, vote = 0, MajorityVote()
        for row in passing.rows:
            if count == len(values):
                values = np.concatenate([values, np.empty_like(values)])
            values[count] = row
            vote.see(row)
            count += 1
        described = Descriptors(
            values[:count], tuple(passing.names), self.method, self.metric, self.settings(), passing.image_names
        )
        if passing.source is not None:
            vote.warn_of_equal(described.values, passing.source)
        return described

    def describe_passing(
        self,
        images: Traverse | RecordedFrames | NDArray[np.uint8] | Sequence[NDArray[np.uint8]],
        *,
        batch: int | None = None,
        progress: Progress = quiet,
    ) -> PassingDescriptors:
        """Does what `describe` does, for a reader who does not keep the descriptors in memory.

        Args:
            images: As for `describe`.
            batch: As for `describe`.
            progress: Shows how many images are described.

        Returns:
            The descriptors, of which none is made yet. Reading them raises what `describe` raises.

        Raises:
            ConfigError: `batch` is below 1.
            RouteError: There are no images.
        """
        batch = self.batch if batch is None else batch
        if batch < 1:
            raise ConfigError(f"a batch of {batch} images is not possible; give at least 1")
        if isinstance(images, RecordedFrames):
            passed: list[str] = []
            drive = images.drive
            rows = progress(
                self.rows(images.pixels(self.image, passed), batch), f"describing {drive.name}", drive.count
            )
            return PassingDescriptors(iter(rows), drive.count, passed, None, images.path)
        names: tuple[str, ...]
        image_names: tuple[str, ...] | None = None
        source: Path | None = None
        if isinstance(images, Traverse):
            names, image_names = images.stems, tuple(map(operator.add, images.stems, images.endings))
            described, source = self.rows_of_files(images.paths, batch), images.root
        else:
            arrays = [images] if isinstance(images, np.ndarray) else images
            names = tuple(map(str, range(len(arrays))))
            described = self.rows((convert_image(array, self.image) for array in arrays), batch)
        if not names:
            raise RouteError("there are no images to describe; choose a directory or frames that hold some")
        rows = progress(described, "describing", len(names))
        return PassingDescriptors(iter(rows), len(names), names, image_names, source)

    def map_blocks(self, work: Callable[[Describer, T], R], blocks: Iterable[T]) -> Iterator[R]:
        """Does work that needs this method with one block after the other.

        Args:
            work: Called with the method and a block; a function of a module, or `partial` of one.
            blocks: Read as the results are.

        Yields:
            The results, in the order of the blocks.
        """
        return (work(self, block) for block in blocks)

    def rows_of_files(self, paths: Sequence[Path], batch: int) -> Iterator[NDArray[np.float32]]:
        """Yields what `rows` does of image files.

        Raises:
            ImageError: One cannot be decoded.
            DescriptorsError: As `rows`.
        """
        return self.rows(decode_images(paths, self.image), batch)

    def rows(self, images: Iterator[NDArray[np.uint8]], batch: int) -> Iterator[NDArray[np.float32]]:
        """Yields the (D,) descriptor of every image, which are as `image` says, in batches of at most `batch`.

        Raises:
            DescriptorsError: The method gives arrays of another shape.
        """
        with contextlib.closing(gather_batches(images, batch)) as batches:
            for gathered in batches:
                values, wanted = self.describe_batch(gathered), (len(gathered), self.dimension)
                if values.shape != wanted:
                    raise DescriptorsError(f"{self.method} returned an array of shape {values.shape}, not {wanted}")
                yield from values


def require_no_argument(method: str, argument: str) -> None:
    """Raises MethodError if a method that has no options was given an argument."""
    if argument:
        raise MethodError(f"the method {method!r} takes no argument; write {method} instead of {method}:{argument}")
