"""Changing an image at random, against the OpenCV calls that it comes down to, with amounts drawn beforehand."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ratio import Ratio
from everplace.training.augment import Augmentation, augment, augmentation_rng

# The largest ratio wanted of each shape: a small image costs about as much as its random generator.
SHAPES = {(32, 64, 1): 5.0, (224, 224, 3): 1.5}
IMAGES = 500
ROUNDS = 5
ALL = Augmentation(shift=0.1, crop=0.1, brightness=0.1, contrast=0.1, blur=1.0)


def measure(scratch: Path) -> list[Ratio]:
    del scratch
    return [_measure(shape, wanted) for shape, wanted in SHAPES.items()]


def _measure(shape: tuple[int, int, int], wanted: float) -> Ratio:
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    height, width = shape[:2]
    moved = np.array([[0.95, 0.0, 1.5], [0.0, 0.95, 2.5]])

    def bare(_: int) -> None:
        warped = cv2.warpAffine(
            image,
            moved,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        cv2.GaussianBlur(cv2.addWeighted(warped, 1.05, warped, 0.0, 3.0), (0, 0), 0.5)

    seconds, bare_seconds = [], []
    for _ in range(ROUNDS):  # by turns, so that a busy machine slows both
        seconds.append(_time(lambda index: augment(image, ALL, augmentation_rng(0, 0, index))))
        bare_seconds.append(_time(bare))
    whole, least = min(seconds), min(bare_seconds)
    return Ratio(
        f"augmenting an image of {height}×{width}×{shape[2]}",
        f"{whole * 1e6:.0f} µs",
        f"{least * 1e6:.0f} µs, the calls of OpenCV alone",
        whole / least,
        at_most=wanted,
    )


def _time(work: Callable[[int], object]) -> float:
    """Seconds an image."""
    start = time.perf_counter()
    for index in range(IMAGES):
        work(index)
    return (time.perf_counter() - start) / IMAGES
