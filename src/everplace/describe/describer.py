"""What every method that describes images offers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec

__all__ = [
    "Describer",
    "FittedDescriber",
    "LargeDescriber",
    "Metric",
    "ProbabilisticDescriber",
    "Settings",
    "require_images",
    "require_no_argument",
]

Metric: TypeAlias = Literal["cosine", "mean-absolute-difference", "place-posterior"]
Settings: TypeAlias = Mapping[str, str | int | float | bool]


class Describer(Protocol):
    """A method, opened and ready.

    Attributes:
        method: The name under which its descriptors are known; only descriptors of one method are compared.
        image: What its input images must be: size, grey or colour.
        dimension: D, the number of values of one descriptor.
        metric: How two of its descriptors are compared.
    """

    @property
    def method(self) -> str: ...  # noqa: D102

    @property
    def image(self) -> ImageSpec: ...  # noqa: D102

    @property
    def dimension(self) -> int: ...  # noqa: D102

    @property
    def metric(self) -> Metric: ...  # noqa: D102

    def settings(self) -> dict[str, str | int | float | bool]:
        """Returns what changes the numbers, nothing else: only descriptors of equal settings are compared."""
        ...

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes a batch; each row depends on its own image alone.

        Args:
            images: B×H×W×C, as `image` says (C = 1 grey, 3 RGB), values 0 to 255.

        Returns:
            B×D finite numbers.
        """
        ...


@runtime_checkable
class ProbabilisticDescriber(Describer, Protocol):
    """A describer that also knows how sure it is of each value, such as a VAE's posterior."""

    def describe_with_variance(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns B×D values, equal to those of `describe`, and their B×D variances, not negative."""
        ...


@runtime_checkable
class FittedDescriber(Describer, Protocol):
    """A describer that was fitted on frames, which are then no test of it."""

    @property
    def seen_stems(self) -> frozenset[str]:
        """Stems of the frames that it was fitted on or chosen by; empty where that was not recorded."""
        ...


@runtime_checkable
class LargeDescriber(Describer, Protocol):
    """A describer whose memory grows with the images it describes at once, such as a deep network.

    Attributes:
        batch: Images at once where nobody asks for another number.
    """

    @property
    def batch(self) -> int: ...  # noqa: D102


def require_images(images: NDArray[np.uint8], spec: ImageSpec, method: str) -> None:
    """Raises MethodError unless `images` is a uint8 batch B×H×W×C as `spec` says."""
    size = images.shape[1:3] if spec.size is None else spec.size
    if images.ndim != 4 or images.dtype != np.uint8 or images.shape[1:] != (*size, spec.channels):
        wanted = "×".join(map(str, (*(spec.size or ("H", "W")), spec.channels)))
        raise MethodError(
            f"{method} describes uint8 images of shape B×{wanted}, not {images.dtype} of {images.shape}; "
            "decode them with the ImageSpec of the method"
        )


def require_no_argument(method: str, argument: str) -> None:
    """Raises MethodError if a method that has no options was given an argument."""
    if argument:
        raise MethodError(f"the method {method!r} takes no argument; write {method} instead of {method}:{argument}")
