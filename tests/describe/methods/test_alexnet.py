"""AlexNet's conv3: the published layout, an independent computation, and what happens without weights."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace import downloads
from everplace.describe.methods import alexnet
from everplace.describe.pretrained.gaussian_projection import GaussianProjection
from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.registry import open_describer
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec

DIMENSION = 48  # instead of 4,096: the matrix of that many rows takes 1 GB


@pytest.fixture(scope="module")
def weights(
    tmp_path_factory: pytest.TempPathFactory,
    save_random_weights: Callable[[Path, Mapping[str, nn.Module]], dict[str, Tensor]],
) -> tuple[Path, dict[str, Tensor]]:
    path = tmp_path_factory.mktemp("alexnet") / "random.pth"
    return path, save_random_weights(path, {"features": alexnet.alexnet_features()})


@pytest.fixture
def describer(weights: tuple[Path, dict[str, Tensor]], monkeypatch: pytest.MonkeyPatch) -> NetworkDescriber:
    monkeypatch.setattr(alexnet, "_DIMENSION", DIMENSION)
    return alexnet.open_method(str(weights[0]))


def batch(frames: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (frames, 224, 224, 3), dtype=np.uint8)


def test_the_layout_is_the_published_one() -> None:
    features = alexnet.alexnet_features()
    assert sum(parameter.numel() for parameter in features.parameters()) == 2_469_696
    assert {key: tuple(value.shape) for key, value in features.state_dict().items()} == {
        "0.weight": (64, 3, 11, 11), "0.bias": (64,),
        "3.weight": (192, 64, 5, 5), "3.bias": (192,),
        "6.weight": (384, 192, 3, 3), "6.bias": (384,),
        "8.weight": (256, 384, 3, 3), "8.bias": (256,),
        "10.weight": (256, 256, 3, 3), "10.bias": (256,),
    }  # fmt: skip
    with torch.inference_mode():
        assert features(torch.zeros(2, 3, 224, 224)).shape == (2, 256, 6, 6)


def test_the_published_file_is_named_by_its_hash() -> None:
    assert alexnet.WEIGHTS.url.endswith(f"-{alexnet.WEIGHTS.sha256[:8]}.pth")
    assert len(alexnet.WEIGHTS.sha256) == 64


def test_the_descriptor_is_the_projected_conv3_after_its_relu(
    describer: NetworkDescriber, weights: tuple[Path, dict[str, Tensor]]
) -> None:
    images = batch(2)
    w = weights[1]
    x = torch.from_numpy(images).double().permute(0, 3, 1, 2) / 255
    x = (x - torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)) / torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
    w = {key: value.double() for key, value in w.items()}
    x = functional.conv2d(x, w["features.0.weight"], w["features.0.bias"], stride=4, padding=2).clamp(min=0)
    x = functional.max_pool2d(x, 3, 2)
    x = functional.conv2d(x, w["features.3.weight"], w["features.3.bias"], padding=2).clamp(min=0)
    x = functional.max_pool2d(x, 3, 2)
    x = functional.conv2d(x, w["features.6.weight"], w["features.6.bias"], padding=1).clamp(min=0)
    conv3 = x.reshape(2, 64_896).numpy()
    expected = conv3 @ GaussianProjection(64_896, DIMENSION, 0).matrix.numpy().astype(np.float64).T / DIMENSION**0.5
    values = describer.describe_batch(images)
    assert values.dtype == np.float32
    assert np.allclose(values, expected, atol=1e-4 * np.abs(expected).max())


def test_it_says_what_it_is(describer: NetworkDescriber, weights: tuple[Path, dict[str, Tensor]]) -> None:
    assert (describer.method, describer.image, describer.metric) == ("alexnet", ImageSpec((224, 224)), "cosine")
    assert describer.settings() == {
        "height": 224, "width": 224, "mean": "0.485 0.456 0.406", "std": "0.229 0.224 0.225",
        "layer": "conv3, after ReLU", "projection_seed": 0,
        "weights": hashlib.sha256(weights[0].read_bytes()).hexdigest()[:16],
    }  # fmt: skip


def test_each_row_depends_on_its_own_image_alone(
    describer: NetworkDescriber, weights: tuple[Path, dict[str, Tensor]]
) -> None:
    images = batch(3)
    together = describer.describe_batch(images)
    again = alexnet.open_method(str(weights[0])).describe_batch(images)
    assert np.array_equal(together, again)
    for index in range(3):
        assert np.allclose(describer.describe_batch(images[index : index + 1])[0], together[index], atol=1e-4)


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    torch.save({"features.0.weight": torch.zeros(64, 3, 3, 3)}, tmp_path / "vgg.pth")
    with pytest.raises(MethodError, match=r"no weights of AlexNet: features\.0\.weight has shape \(64, 3, 3, 3\)"):
        open_describer(f"alexnet:{tmp_path / 'vgg.pth'}")


def test_without_network_and_weights_one_sentence_says_how_to_get_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path))
    with pytest.raises(MethodError, match="download https://download.pytorch.org/.* and put it at"):
        alexnet.open_method("")  # opening alone asks no server
    monkeypatch.setattr(downloads, "_ATTEMPTS", 1)
    monkeypatch.setattr(alexnet, "WEIGHTS", replace(alexnet.WEIGHTS, url="http://127.0.0.1:9/alexnet-7be5be79.pth"))
    with pytest.raises(
        MethodError, match=r"AlexNet needs its published weights: cannot fetch http.*put it at"
    ) as caught:
        open_describer("alexnet")
    assert str(tmp_path / "weights" / "alexnet-7be5be79.pth") in str(caught.value)


@pytest.mark.slow
def test_it_has_4096_values(weights: tuple[Path, dict[str, Tensor]]) -> None:
    describer = open_describer(f"alexnet:{weights[0]}")
    values = describer.describe_batch(batch(2))
    assert values.shape == (2, describer.dimension) == (2, 4096)
    assert np.isfinite(values).all()
