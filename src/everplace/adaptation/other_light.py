"""What weather, light and season do to an image, as operations on images: the same view as another drive may see it.

They tell, before a second drive exists, in which directions a descriptor changes while the place does not. Chosen on
training places of real drives (see docs/results.md); the strongest is `_snow`, which takes the texture of the ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["CHANGES", "changed"]

_Image = NDArray[np.float32]
_Change = Callable[[_Image, np.random.Generator], _Image]


def changed(images: NDArray[np.uint8], first: int = 0) -> Iterator[NDArray[np.uint8]]:
    """Images under each of the changes.

    What is drawn for an image depends on its number alone, so blocks may be cut as one likes.

    Args:
        images: N×H×W×C, values 0 to 255.
        first: Number of the first image.

    Yields:
        For each of `CHANGES` N×H×W×C.
    """
    for number, change in enumerate(CHANGES):
        out = np.empty_like(images)
        for index, image in enumerate(images):
            rng = np.random.default_rng((number, first + index))
            shown = change(image.astype(np.float32) / 255, rng)
            np.rint(np.clip(shown, 0, 1) * 255, out=out[index], casting="unsafe")
        yield out


def _brightness(image: _Image, rng: np.random.Generator) -> _Image:
    """Another exposure curve."""
    return np.asarray(image ** np.float32(math.exp(0.5 * rng.standard_normal())))


def _glare(image: _Image, rng: np.random.Generator) -> _Image:
    """Too little light, or so much that bright parts burn out."""
    return image * np.float32(math.exp(rng.uniform(-0.3, 1.0)))


def _grain(image: _Image, rng: np.random.Generator) -> _Image:
    """Noise of a sensor in the dark."""
    return _noisy(image, rng, 0.02)


def _shadow(image: _Image, rng: np.random.Generator) -> _Image:
    """Light that varies across the view: shadows, headlights."""
    return np.asarray(image * np.exp(0.5 * _field(image, rng, (2, 4))))


def _haze(image: _Image, rng: np.random.Generator) -> _Image:
    """Fog, rain or spray in parts of the view."""
    depth = 2 * _field(image, rng, (3, 5)) + np.float32(rng.standard_normal())
    share = np.float32(0.95) / (1 + np.exp(-depth))
    air = np.float32(0.5) + np.float32(0.25) * _field(image, rng, (2, 3))
    return _noisy(image * (1 - share) + air * share, rng, 0.01)


def _viewpoint(image: _Image, rng: np.random.Generator) -> _Image:
    """A camera that hangs or drives a little elsewhere."""
    height, width = image.shape[:2]
    turned = cv2.getRotationMatrix2D(
        (width / 2, height / 2), rng.standard_normal(), math.exp(0.03 * rng.standard_normal())
    )
    turned[:, 2] += height * np.array([0.058, 0.027]) * rng.standard_normal(2)
    moved = cv2.warpAffine(image, turned, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(moved, np.float32).reshape(image.shape)


def _snow(image: _Image, rng: np.random.Generator) -> _Image:
    """The lower half white and without most of its texture."""
    height = image.shape[0]
    smooth = cv2.GaussianBlur(image, (0, 0), height / 16).reshape(image.shape)
    low = 1 / (1 + np.exp(-20 * (np.linspace(0, 1, height, dtype=np.float32) - np.float32(0.45))))[:, None, None]
    kept = np.float32(max(rng.uniform(-0.2, 0.6), 0.0))
    white = np.float32(0.8) + np.float32(0.1) * _field(image, rng, (2, 4))
    covered = smooth * (1 - low) + white * low + (image - smooth) * (1 - low + kept * low)
    return _noisy(covered, rng, 0.02)


CHANGES: tuple[_Change, ...] = (_brightness, _glare, _grain, _shadow, _haze, _viewpoint, _snow)
"""The changes, all of one weight."""


def _noisy(image: _Image, rng: np.random.Generator, deviation: float) -> _Image:
    return image + np.float32(deviation) * rng.standard_normal(image.shape, np.float32)


def _field(image: _Image, rng: np.random.Generator, cells: tuple[int, int]) -> _Image:
    """H×W×1: a smooth random field of about unit variance."""
    height, width = image.shape[:2]
    drawn = rng.standard_normal(cells, np.float32)
    return np.asarray(cv2.resize(drawn, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)[:, :, None]
