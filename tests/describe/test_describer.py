"""What methods refuse to describe."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from everplace.describe.describer import require_images
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec


@pytest.mark.parametrize(
    ("shape", "spec"),
    [
        ((2, 4, 6, 1), ImageSpec((4, 6), grey=True)),
        ((0, 4, 6, 3), ImageSpec((4, 6))),
        ((2, 9, 5, 3), ImageSpec()),
        ((2, 9, 5, 1), ImageSpec(grey=True)),
    ],
)
def test_images_as_asked_for_pass_as_they_are_and_no_others(shape: tuple[int, ...], spec: ImageSpec) -> None:
    images = np.arange(math.prod(shape), dtype=np.uint8).reshape(shape)
    before = images.copy()
    require_images(images, spec, "m")
    np.testing.assert_array_equal(images, before)
    # Of the same numbers, each of these differs in one thing.
    others: list[Any] = [images.astype(np.int16), images[None], images[..., [0] * (4 - shape[-1])]]
    if spec.size is not None:
        others += [np.zeros((*shape[:1], spec.size[0] + 1, *shape[2:]), np.uint8)]
    for other in others:
        with pytest.raises(MethodError, match="m describes uint8 images of shape"):
            require_images(other, spec, "m")


@pytest.mark.parametrize(
    "images",
    [
        np.zeros((2, 4, 6, 1), np.float32),
        np.zeros((2, 4, 6, 3), np.uint8),
        np.zeros((2, 6, 4, 1), np.uint8),
        np.zeros((4, 6, 1), np.uint8),
        np.zeros((), np.uint8),
    ],
)
def test_others_are_refused_with_what_is_wanted(images: np.ndarray) -> None:
    with pytest.raises(MethodError, match=r"m describes uint8 images of shape B×4×6×1, not .*ImageSpec"):
        require_images(images, ImageSpec((4, 6), grey=True), "m")
    with pytest.raises(MethodError, match="B×H×W×3"):
        require_images(np.zeros((2, 4, 6, 1), np.uint8), ImageSpec(), "m")
