"""VGG19: the published layout, and both layers against an independent computation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace import downloads
from everplace.describe.methods import vgg19
from everplace.describe.registry import open_describer
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec

SaveRandomWeights: TypeAlias = Callable[[Path, Mapping[str, nn.Module]], dict[str, Tensor]]
CONVOLUTIONS = ((0, 2), (5, 7), (10, 12, 14, 16), (19, 21, 23, 25), (28, 30, 32, 34))
"""Positions of the convolutions in the published `features`, block by block."""


def batch(frames: int) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (frames, 224, 224, 3), dtype=np.uint8)


def blocks(images: NDArray[np.uint8], weights: dict[str, Tensor], count: int) -> Tensor:
    """The first blocks of VGG19, written out."""
    x = torch.from_numpy(images).float().permute(0, 3, 1, 2) / 255
    x = (x - torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)) / torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
    for positions in CONVOLUTIONS[:count]:
        for position in positions:
            weight, bias = weights[f"features.{position}.weight"], weights[f"features.{position}.bias"]
            x = functional.conv2d(x, weight, bias, padding=1).clamp(min=0)
        x = functional.max_pool2d(x, 2)
    return x


def test_the_layout_is_the_published_one() -> None:
    with torch.device("meta"):
        features, classifier = vgg19.vgg19_features(), vgg19.vgg19_classifier()
    assert sum(parameter.numel() for parameter in features.parameters()) == 20_024_384
    positions = [position for block in CONVOLUTIONS for position in block]
    assert list(features.state_dict()) == [
        f"{position}.{kind}" for position in positions for kind in ("weight", "bias")
    ]
    assert {key: tuple(value.shape) for key, value in classifier.state_dict().items()} == {
        "0.weight": (4096, 25088), "0.bias": (4096,), "3.weight": (4096, 4096), "3.bias": (4096,),
    }  # fmt: skip
    assert vgg19.WEIGHTS.url.endswith(f"-{vgg19.WEIGHTS.sha256[:8]}.pth")


@pytest.mark.slow
def test_pool4_is_the_fourth_pooling(tmp_path: Path, save_random_weights: SaveRandomWeights) -> None:
    path = tmp_path / "random.pth"
    weights = save_random_weights(path, {"features": vgg19.vgg19_features()})
    describer = open_describer(f"vgg19:pool4:{path}")
    assert (describer.method, describer.image, describer.metric) == ("vgg19:pool4", ImageSpec((224, 224)), "cosine")
    images = batch(1)
    values = describer.describe_batch(images)
    expected = blocks(images, weights, 4)
    assert expected.shape == (1, 512, 14, 14)
    assert values.shape == (1, describer.dimension) == (1, 100_352)
    assert np.allclose(values[0], expected.numpy().ravel(), atol=1e-4 * float(expected.max()))


@pytest.mark.slow
def test_fc7_is_the_second_layer_of_the_classifier(tmp_path: Path, save_random_weights: SaveRandomWeights) -> None:
    path = tmp_path / "random.pth"
    parts = {"features": vgg19.vgg19_features(), "classifier": vgg19.vgg19_classifier()}
    weights = save_random_weights(path, parts)
    describer = open_describer(f"vgg19:{path}")
    assert (describer.method, describer.dimension) == ("vgg19:fc7", 4096)
    images = batch(2)
    x = blocks(images, weights, 5).flatten(1)
    x = (x @ weights["classifier.0.weight"].T + weights["classifier.0.bias"]).clamp(min=0)
    x = (x @ weights["classifier.3.weight"].T + weights["classifier.3.bias"]).clamp(min=0)
    values = describer.describe_batch(images)
    assert np.allclose(values, x.numpy(), atol=1e-3 * float(x.max()))
    # Nothing is dropped at random, and rows do not mix.
    assert np.allclose(describer.describe_batch(images[1:])[0], values[1], atol=1e-3 * float(x.max()))


def test_arguments_choose_layer_and_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path))
    with pytest.raises(MethodError, match="vgg19 has no layer 'pool5'; choose fc7 or pool4, or give a .pth file"):
        open_describer("vgg19:pool5")
    for argument in ("./none.pth", "fc7:./none.pth", "pool4:none.pth"):
        with pytest.raises(MethodError, match=r"there is no weight file none\.pth"):
            open_describer(f"vgg19:{argument}")
    monkeypatch.setattr(downloads, "_ATTEMPTS", 1)
    monkeypatch.setattr(vgg19, "WEIGHTS", replace(vgg19.WEIGHTS, url="http://127.0.0.1:9/vgg19-dcbb9e9d.pth"))
    for argument in ("vgg19", "vgg19:pool4"):
        with pytest.raises(MethodError, match="VGG19 needs its published weights: .* put it at"):
            open_describer(argument)


def test_a_file_without_the_classifier_does_for_pool4_only(tmp_path: Path) -> None:
    shapes = {key: value.shape for key, value in vgg19.vgg19_features().state_dict().items()}
    path = tmp_path / "features.pth"
    torch.save({f"features.{key}": torch.zeros(shape) for key, shape in shapes.items()}, path)
    with pytest.raises(MethodError, match=r"no weights of VGG19: classifier\.0\.weight is missing"):
        open_describer(f"vgg19:fc7:{path}")
