"""hog16: 2,048 numbers of any frame, and those that `best` starts from."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from everplace.adaptation.oriented_gradients import OrientedGradients
from everplace.describe.registry import method_names, open_describer
from everplace.errors import MethodError
from everplace.route.route import open_route


def picture(height: int, width: int, channels: int = 3) -> NDArray[np.uint8]:
    coarse = np.random.default_rng(0).integers(0, 256, (5, 9, channels), dtype=np.uint8)
    found = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(found.reshape(height, width, channels), np.uint8)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (32, 64), (64, 128), (480, 640), (700, 90), (33, 201)])
def test_any_frame_has_2048_numbers(height: int, width: int) -> None:
    hog16 = open_describer("hog16")
    assert hog16.dimension == 2048
    for image in (picture(height, width), picture(height, width, 1)[..., 0]):
        values = hog16.describe(image).values
        assert values.shape == (1, 2048)
        assert values.dtype == np.float32
        assert np.isfinite(values).all()
        assert (values >= 0).all()


def test_the_numbers_are_the_gradients_of_the_grey_image() -> None:
    grey = picture(64, 128, 1)
    found = open_describer("hog16").describe(grey[..., 0]).values
    wanted = OrientedGradients(64, 128)(torch.from_numpy(grey).permute(2, 0, 1)[None].float() / 255)
    np.testing.assert_array_equal(found, wanted.numpy())


def test_a_frame_of_another_size_is_brought_to_64_by_128() -> None:
    large, hog16 = picture(256, 512, 1)[..., 0], open_describer("hog16")
    shrunk = np.asarray(cv2.resize(large, (128, 64), interpolation=cv2.INTER_AREA), np.uint8)
    np.testing.assert_allclose(hog16.describe(large).values, hog16.describe(shrunk).values, atol=0.02)


def test_colour_and_grey_of_one_view_are_alike() -> None:
    grey, hog16 = picture(64, 128, 1), open_describer("hog16")
    colour = np.repeat(grey, 3, axis=2)
    np.testing.assert_allclose(hog16.describe(colour).values, hog16.describe(grey[..., 0]).values, atol=0.02)


def test_frames_do_not_depend_on_those_beside_them(unchanged_tiny_route: Path) -> None:
    hog16, winter = open_describer("hog16"), open_route(unchanged_tiny_route)["winter"]
    np.testing.assert_allclose(hog16.describe(winter, batch=5).values, hog16.describe(winter).values, atol=1e-5)


def test_it_is_a_method_without_options() -> None:
    assert "hog16" in method_names()
    assert open_describer("hog16").settings() == {"cell": 8, "directions": 16}
    with pytest.raises(MethodError, match="takes no argument; write hog16"):
        open_describer("hog16:8")
