"""What methods refuse to describe."""

from __future__ import annotations

import numpy as np
import pytest

from everplace.data.images import ImageSpec
from everplace.describe.protocol import require_images
from everplace.errors import MethodError


def test_images_as_asked_for_pass() -> None:
    require_images(np.zeros((2, 4, 6, 1), np.uint8), ImageSpec((4, 6), grey=True), "m")
    require_images(np.zeros((0, 4, 6, 3), np.uint8), ImageSpec((4, 6)), "m")
    require_images(np.zeros((2, 9, 5, 3), np.uint8), ImageSpec(), "m")


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
