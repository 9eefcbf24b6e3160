"""Methods side by side: each scaled to unit mean square, each seeing the image as it wants it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import nn

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.joined import JoinedDescriber
from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.registry import open_describer
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec
from everplace.route.route import open_route


class Means(Describer):
    """Mean of each channel, for images of any size."""

    def __init__(self, size: tuple[int, int], grey: bool = False, gain: float = 1.0) -> None:
        self.method, self.image, self.dimension = "means", ImageSpec(size, grey=grey), 1 if grey else 3
        self.batch, self._gain = size[0], gain
        self.seen_stems = frozenset({f"seen {size[0]}"})

    def settings(self) -> Settings:
        return {"gain": self._gain}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        assert images.shape[1:] == (*(self.image.size or ()), self.dimension)
        return np.asarray(images.mean(axis=(1, 2)) * self._gain, np.float32)


def picture(seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (70, 140, 3), dtype=np.uint8)


def test_each_part_has_a_mean_square_of_one() -> None:
    joined = open_describer("hog16+hog")
    values = joined.describe([picture(seed) for seed in range(3)]).values
    assert (joined.method, joined.dimension) == ("hog16+hog", 2048 + 3780)
    for part in (values[:, :2048], values[:, 2048:]):
        np.testing.assert_allclose(np.square(part).mean(axis=1), 1, rtol=1e-5)


def test_the_directions_are_those_of_the_parts() -> None:
    frames = [np.asarray(np.kron(picture(seed)[:64, :64], np.ones((1, 2, 1))), np.uint8) for seed in range(2)]
    values = open_describer("hog16+hog16").describe(frames).values
    alone = open_describer("hog16").describe(frames).values
    wanted = alone / np.sqrt(np.square(alone).mean(axis=1, keepdims=True))
    np.testing.assert_allclose(values, np.concatenate([wanted, wanted], axis=1), rtol=1e-5, atol=1e-6)


def test_a_frame_without_structure_is_zeros_and_no_warning(recwarn: pytest.WarningsRecorder) -> None:
    values = JoinedDescriber([Means((8, 8)), Means((16, 8))]).describe(np.zeros((20, 20, 3), np.uint8)).values
    assert (values == 0).all()
    assert not recwarn.list


def test_every_part_sees_its_own_size_and_colour() -> None:
    joined = JoinedDescriber([Means((8, 12), grey=True), Means((16, 24), gain=5.0), Means((4, 40))])
    assert joined.image == ImageSpec((16, 24), grey=False)
    assert (joined.dimension, joined.batch) == (7, 4)
    assert joined.seen_stems == {"seen 8", "seen 16", "seen 4"}
    values = joined.describe([picture(1)]).values[0]
    assert values[0] == 1
    np.testing.assert_allclose(values[1:4], values[4:], atol=0.02)


def test_of_grey_methods_the_image_is_grey() -> None:
    assert JoinedDescriber([Means((8, 8), grey=True), Means((4, 4), grey=True)]).image.grey


def test_settings_tell_the_parts_apart() -> None:
    joined = JoinedDescriber([Means((8, 8)), Means((8, 8), gain=2.0)])
    assert joined.settings() == {"0.gain": 1.0, "1.gain": 2.0}


def test_frames_do_not_depend_on_those_beside_them(unchanged_tiny_route: Path) -> None:
    joined, winter = open_describer("hog16+hog"), open_route(unchanged_tiny_route)["winter"]
    whole = joined.describe(winter).values
    np.testing.assert_allclose(joined.describe(winter, batch=1).values, whole, atol=1e-5)
    np.testing.assert_allclose(joined.describe(winter[3:5]).values, whole[3:5], atol=1e-5)


@pytest.mark.parametrize(
    ("method", "says"),
    [
        ("hog16+sad", "the method sad cannot be joined with others: only methods that are compared by cosine"),
        ("sad+hog", "the method sad cannot be joined"),
        ("hog16+nothing", "there is no method or run directory 'hog16+nothing'"),
        ("hog16+", "there is no method or run directory 'hog16+'"),
        ("+", "there is no method"),
        ("hog16+hog:9", "the method 'hog' takes no argument"),
    ],
)
def test_what_cannot_be_joined_is_one_sentence(method: str, says: str) -> None:
    with pytest.raises(MethodError) as caught:
        open_describer(method)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_run_whose_name_has_a_plus_is_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hog16+hog").mkdir()
    monkeypatch.chdir(tmp_path)
    assert isinstance(open_describer("hog16+hog"), JoinedDescriber)
    (tmp_path / "hog16+hog" / "config.toml").write_text("")
    with pytest.raises(Exception, match=r"checkpoint\.json is missing"):
        open_describer("hog16+hog")


def small_network(size: tuple[int, int]) -> NetworkDescriber:
    return NetworkDescriber("small", nn.Sequential(nn.AvgPool2d(8), nn.Flatten()), settings={}, batch=4, size=size)


@pytest.mark.parametrize("size", [(128, 256), (64, 128), (32, 64)])
def test_the_network_of_parts_rounds_grey_and_halves_as_images_do(size: tuple[int, int]) -> None:
    joined = JoinedDescriber([open_describer("hog16"), small_network(size)])
    assert joined.image.size is not None
    images = np.random.default_rng(0).integers(0, 256, (3, *joined.image.size, 3), dtype=np.uint8)
    images[2] = 128  # says nothing to the gradients
    network = joined.network()
    assert network is not None
    with torch.inference_mode():
        values = network(torch.from_numpy(images).permute(0, 3, 1, 2) / 255).numpy()
    np.testing.assert_allclose(values, joined.describe_batch(images), atol=1e-5)


def test_parts_of_other_factors_or_without_a_network_are_none() -> None:
    odd = JoinedDescriber([open_describer("hog16"), small_network((96, 96))])
    with pytest.raises(MethodError, match="small resizes|hog16 resizes") as caught:
        odd.network()
    assert "another factor than one half" in str(caught.value)
    assert JoinedDescriber([open_describer("hog16"), open_describer("hog")]).network() is None
