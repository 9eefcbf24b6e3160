"""How pixels become what a pretrained network was trained on: numbers of a known mean and spread."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from everplace.errors import ConfigError

__all__ = ["IMAGENET", "Normalisation", "network_input"]


@dataclass(frozen=True, slots=True)
class Normalisation:
    """Mean and spread by channel, of values in [0, 1].

    Attributes:
        mean: What is subtracted: one number, or one a channel.
        std: What the rest is divided by: one number, or one a channel; not 0.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raises `ConfigError` for numbers that would make an input that is not finite."""
        if not all(map(math.isfinite, (*self.mean, *self.std))) or 0 in self.std:
            raise ConfigError(f"mean {self.mean} and std {self.std} must be finite, and std not 0")


IMAGENET = Normalisation((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Of the RGB images of ImageNet, as all networks take them that torchvision publishes."""


def network_input(images: NDArray[np.uint8], normalisation: Normalisation) -> NDArray[np.float32]:
    """Computes (x / 255 - mean) / std.

    Args:
        images: B×H×W×C, 0 to 255.
        normalisation: Of C channels, or of one number for all.

    Returns:
        B×C×H×W, C-contiguous.
    """
    mean, std = (np.asarray(values, np.float32) for values in (normalisation.mean, normalisation.std))
    values = images.astype(np.float32)
    values /= 255
    values -= mean
    values /= std
    return np.ascontiguousarray(values.transpose(0, 3, 1, 2))
