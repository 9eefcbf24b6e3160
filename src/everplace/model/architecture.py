"""The encoder and the decoder of Oh and Eoh (2021), Table 1."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from everplace.adaptation.oriented_gradients import OrientedGradients
from everplace.model.convolution import Convolution, TransposedConvolution
from everplace.model.model_config import ModelConfig
from everplace.model.posterior import LatentSplit, Posterior

__all__ = [
    "Decoder",
    "Encoder",
    "InstanceBatchNorm2d",
    "feature_map",
    "flattened_size",
    "hidden_widths",
    "strides",
]

CONVOLUTIONS = (32, 64, 64, 128, 128)
FULLY_CONNECTED = (4096, 2048, 1024, 512)
SMALLEST_SIDE = 4
FREE_OF_CONTRAST = 3
"""How many of the first convolutions normalise half of their channels for each image alone (instance normalisation)."""


def feature_map(height: int, width: int) -> tuple[int, int, int]:
    """How far the convolutions shrink an image.

    As many of the five convolutions have stride 2 as leave at least 4 cells on the short side (decided; at 224x224
    all five, which is Table 1).

    Returns:
        Number of stride-2 convolutions, and height and width of the last feature map.
    """
    halvings = len(CONVOLUTIONS)
    while halvings > 1 and min(height, width) >> halvings < SMALLEST_SIDE:
        halvings -= 1
    return halvings, height >> halvings, width >> halvings


def flattened_size(height: int, width: int) -> int:
    """How many numbers the last feature map holds."""
    _, rows, columns = feature_map(height, width)
    return CONVOLUTIONS[-1] * rows * columns


def strides(height: int, width: int) -> tuple[int, ...]:
    """Stride of each of the five convolutions: those that do not halve are the second, then the fourth (decided).

    On a small image this puts a layer of stride 1 between two halvings.
    """
    halvings, _, _ = feature_map(height, width)
    full = (1, 3)[: len(CONVOLUTIONS) - halvings]
    return tuple(1 if i in full else 2 for i in range(len(CONVOLUTIONS)))


def hidden_widths(flattened: int, *, fully_connected: bool = True) -> tuple[int, ...]:
    """The fully connected chain: Table 1's widths, from the first one below the flattened size (decided)."""
    return tuple(width for width in FULLY_CONNECTED if fully_connected and width < flattened)


class InstanceBatchNorm2d(nn.Module):
    """Half of the channels normalised for each image alone, half over the batch (IBN-a, Pan et al. 2018).

    The first half loses brightness and contrast, which differ between the conditions; the second keeps them for z_c.
    Decided; the paper is silent.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.instance = nn.InstanceNorm2d(channels // 2, affine=True)
        self.batch = nn.BatchNorm2d(channels - channels // 2)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) to the same shape."""
        alone = self.instance.num_features
        return torch.cat((self.instance(x[:, :alone]), self.batch(x[:, alone:])), dim=1)


def _convolution(inputs: int, outputs: int, stride: int, *, free_of_contrast: bool) -> nn.Sequential:
    return nn.Sequential(
        Convolution(inputs, outputs, 3, stride, padding=1, bias=False),
        InstanceBatchNorm2d(outputs) if free_of_contrast else nn.BatchNorm2d(outputs),
        nn.LeakyReLU(0.1),
    )


def _transposed(inputs: int, outputs: int, stride: int) -> nn.Sequential:
    kernel = 4 if stride == 2 else 3
    return nn.Sequential(
        TransposedConvolution(inputs, outputs, kernel, stride, padding=1, bias=False),
        nn.BatchNorm2d(outputs),
        nn.LeakyReLU(0.1),
    )


def _linear(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, outputs, bias=False), nn.BatchNorm1d(outputs))


class Encoder(nn.Module):
    """q(z|x): Table 1, five convolutions, a fully connected chain, mean and log-variance.

    | step at 224x224x3      | output shape        |
    |------------------------|---------------------|
    | images                 | (B, 3, 224, 224)    |
    | conv1                  | (B, 32, 112, 112)   |
    | conv2                  | (B, 64, 56, 56)     |
    | conv3                  | (B, 64, 28, 28)     |
    | conv4                  | (B, 128, 14, 14)    |
    | conv5                  | (B, 128, 7, 7)      |
    | flatten                | (B, 6272)           |
    | fc6, fc7, fc8, fc9     | (B, 4096), (B, 2048), (B, 1024), (B, 512) |
    | z_mean, z_log_variance | (B, 128), (B, 128)  |

    The fully connected chain has batch normalisation and no activation (decided by experiment: with one, the chain
    learns the training places by heart).

    The encoder of the plain autoencoder (`cae`) ends in z_mean alone: its code. With `oriented_gradients`, a remedy
    that the paper does not have, z_mean is that of z_c, and the mean of z_p is `place_projection` of the gradients.
    """

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        channels = (config.channels, *CONVOLUTIONS)
        self.convolutions = nn.ModuleList(
            _convolution(channels[i], channels[i + 1], stride, free_of_contrast=i < FREE_OF_CONTRAST)
            for i, stride in enumerate(strides(config.height, config.width))
        )
        flattened = flattened_size(config.height, config.width)
        widths = (flattened, *hidden_widths(flattened, fully_connected=config.fully_connected))
        self.fully_connected = nn.ModuleList(_linear(a, b) for a, b in pairwise(widths))
        self.split = LatentSplit(config.place_dimensions, config.condition_dimensions)
        self.gradients = OrientedGradients(config.height, config.width) if config.oriented_gradients else None
        self.place_projection: nn.Linear | None = None
        read_off = config.latent_dimensions
        if self.gradients is not None:
            self.place_projection = nn.Linear(self.gradients.features, config.place_dimensions)
            read_off = config.condition_dimensions
        self.z_mean = nn.Linear(widths[-1], read_off)
        self.z_log_variance = None if config.kind == "cae" else nn.Linear(widths[-1], config.latent_dimensions)

    def forward(self, images: Tensor) -> Posterior:
        """Encodes images.

        Args:
            images: (B, C, H, W) in [0, 1].

        Returns:
            The posterior, in float32 also under autocast, as the bound needs it.
        """
        x = self.features(images)
        mean = self.z_mean(x).float()
        if self.z_log_variance is None:
            return Posterior(mean, None)
        if self.place_projection is not None:
            mean = self.split.join(self.projected_place(images), mean)
        # A bounded log-variance keeps exp() finite in the first steps; +-10 is far outside what training reaches.
        log_variance = self.z_log_variance(x).float().clamp(-10.0, 10.0)
        return Posterior(mean, log_variance)

    def features(self, images: Tensor) -> Tensor:
        """What mean and log-variance are read off: (B, C, H, W) in [0, 1] to the end of the fully connected chain."""
        x = images - 0.5
        for convolution in self.convolutions:
            x = convolution(x)
        x = x.flatten(1)
        for layer in self.fully_connected:
            x = layer(x)
        return x

    def projected_place(self, images: Tensor) -> Tensor:
        """The mean of z_p of an encoder with oriented gradients, which needs no convolution.

        Args:
            images: (B, C, H, W) in [0, 1].

        Returns:
            (B, P) float32, also under autocast: the projection is a difference of many large numbers, too fine for
            bfloat16.
        """
        assert self.gradients is not None
        assert self.place_projection is not None
        with torch.autocast(images.device.type, enabled=False):
            mean: Tensor = self.place_projection(self.gradients(images))
        return mean


class Decoder(nn.Module):
    """The mean of p(x|z): the encoder's mirror, (B, 128) to (B, C, H, W), unbounded but trained towards [0, 1]."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        _, self.height, self.width = feature_map(config.height, config.width)
        flattened = CONVOLUTIONS[-1] * self.height * self.width
        widths = (
            config.latent_dimensions,
            *reversed(hidden_widths(flattened, fully_connected=config.fully_connected)),
            flattened,
        )
        self.fully_connected = nn.ModuleList(_linear(a, b).append(nn.LeakyReLU(0.1)) for a, b in pairwise(widths))
        channels = tuple(reversed(CONVOLUTIONS))
        steps = tuple(reversed(strides(config.height, config.width)))
        self.convolutions = nn.ModuleList(
            _transposed(a, b, step) for a, b, step in zip(channels, channels[1:], steps, strict=False)
        )
        last = steps[-1]
        self.output = TransposedConvolution(channels[-1], config.channels, 4 if last == 2 else 3, last, padding=1)

    def forward(self, z: Tensor) -> Tensor:
        """Decodes latents.

        Args:
            z: (B, D).

        Returns:
            (B, C, H, W), float32.
        """
        x = z
        for layer in self.fully_connected:
            x = layer(x)
        x = x.view(len(x), CONVOLUTIONS[-1], self.height, self.width)
        for convolution in self.convolutions:
            x = convolution(x)
        mean: Tensor = self.output(x).float() + 0.5
        return mean
