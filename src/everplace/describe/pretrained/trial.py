"""A first look at a foreign network: how many numbers it gives, and what it says where it fails."""

from __future__ import annotations

import numpy as np

from everplace.describe.describer import Describer
from everplace.errors import EverplaceError, MethodError

__all__ = ["first_line", "measured_dimension"]


def measured_dimension(describer: Describer, name: str, remedy: str) -> int:
    """D, learnt from one grey image, which also shows whether the network takes this size at all.

    Args:
        describer: Opened but for its dimension; its images have a fixed size.
        name: What the message calls the network.
        remedy: What to do if it does not take the image.

    Raises:
        MethodError: It does not.
    """
    assert describer.image.size is not None
    height, width = describer.image.size
    grey = np.full((1, height, width, describer.image.channels), 128, np.uint8)
    try:
        return int(describer.describe_batch(grey).shape[1])
    except (EverplaceError, MemoryError):
        raise
    except Exception as error:  # foreign code raises anything
        if type(error).__name__ == "OutOfMemoryError":  # torch's
            raise
        raise MethodError(f"{name} fails on an image of {height}×{width}: {first_line(error)}; {remedy}") from error


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or its kind where it has none."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)
