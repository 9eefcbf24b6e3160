"""A drive's frames, described while they are read."""

from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from tests.mapping.drives import another_camera, images_of, write_drive

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.registry import open_describer
from everplace.errors import DescriptorsError, ImageError, RouteError
from everplace.images.decoding import ImageSpec
from everplace.mapping.described_drive import describe_drive, thumbnail
from everplace.mapping.drive_source import DriveFrames, open_drive
from everplace.route.folder import open_traverse


def test_features_are_those_of_the_method(unchanged_rendered_route: Path) -> None:
    describer = open_describer("hog16")
    summer = open_traverse(unchanged_rendered_route / "summer")[:9]
    found = describe_drive(open_drive(summer), describer, in_other_light=False)
    assert found.stems == summer.stems
    np.testing.assert_array_equal(found.features, describer.describe(summer).values.astype(np.float16))
    assert found.light is None
    assert len(found) == 9
    assert np.isnan(found.seconds).all()


def test_frames_of_one_drive_may_differ_in_size_and_be_grey(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    images = images_of(unchanged_rendered_route / "summer")[:4]
    mixed = [images[0], another_camera(images[1]), cv2.cvtColor(images[2], cv2.COLOR_RGB2GRAY), images[3][:40, :50]]
    drive = open_drive(write_drive(tmp_path / "mixed", [np.asarray(image, np.uint8) for image in mixed]))
    found = describe_drive(drive, open_describer("hog16"), in_other_light=False)
    assert found.features.shape == (4, 2048)
    sizes = [Image.open(io.BytesIO(data)).size for data in found.thumbnails]
    assert sizes == [(128, 64), (160, 100), (128, 64), (50, 40)]


def test_a_thumbnail_shows_the_picture(unchanged_rendered_route: Path) -> None:
    image = images_of(unchanged_rendered_route / "summer")[0]
    large = np.asarray(cv2.resize(image, (640, 320)), np.uint8)
    small = np.asarray(Image.open(io.BytesIO(thumbnail(large))))
    assert small.shape == (80, 160, 3)
    assert np.abs(small.astype(int) - cv2.resize(image, (160, 80))).mean() < 8


def test_other_light_changes_the_features_but_little(unchanged_rendered_route: Path) -> None:
    describer = open_describer("hog16")
    drive = open_traverse(unchanged_rendered_route / "summer")[:10]
    found = describe_drive(open_drive(drive), describer, in_other_light=True)
    assert found.light is not None
    spread = np.trace(np.cov(found.features.astype(float).T))
    assert 0 < np.trace(found.light.second_moment()) < spread


def test_a_drive_without_frames_is_refused() -> None:
    with pytest.raises(RouteError, match="'nothing' holds no frame"):
        describe_drive(DriveFrames("nothing", iter(())), open_describer("hog16"), in_other_light=False)


def test_a_broken_frame_is_named(tiny_route: Path) -> None:
    (tiny_route / "summer" / "5.png").write_bytes(b"no picture")
    with pytest.raises(ImageError, match="5.png"):
        describe_drive(open_drive(tiny_route / "summer"), open_describer("hog16"), in_other_light=False)


@pytest.mark.parametrize("number", [7e4, np.inf, np.nan])
def test_numbers_that_16_bits_do_not_hold_are_refused(unchanged_rendered_route: Path, number: float) -> None:
    class Loud(Describer):
        method, image, dimension = "loud", ImageSpec((8, 8), grey=True), 2

        def settings(self) -> Settings:
            return {}

        def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
            return np.full((len(images), 2), number, np.float32)

    drive = open_drive(open_traverse(unchanged_rendered_route / "summer")[:3])
    with pytest.raises(DescriptorsError, match="loud gives numbers .* of summer"):
        describe_drive(drive, Loud(), in_other_light=False)
