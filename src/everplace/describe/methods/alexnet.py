"""AlexNet's conv3, pretrained on ImageNet: 4,096 numbers, 16,384 bytes a descriptor.

Krizhevsky, "One weird trick for parallelizing convolutional neural networks", 2014 (the one-tower version, for which
torchvision publishes weights); as a place descriptor by Sünderhauf et al., "On the Performance of ConvNet Features for
Place Recognition", IROS 2015. The features are those after conv3's ReLU: Sünderhauf et al. read the blob `conv3` of
Caffe, whose ReLU works in place. Their 384×13×13 numbers are projected to 4,096 by a Gaussian matrix of a fixed seed
and compared by cosine.

`alexnet` uses torchvision's weights; `alexnet:FILE.pth` uses a file of the same layout.
"""

from __future__ import annotations

import torch
from torch import nn

from everplace.describe.pretrained.gaussian_projection import GaussianProjection
from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.pretrained.weights import PublishedWeights, fetch_weights, load_weights, weight_file
from everplace.progress import Progress

__all__ = ["WEIGHTS", "alexnet_features", "open_method", "prepare"]

NOTES = (("alexnet", "AlexNet's conv3 trained on ImageNet, projected", "a download of 244 MB at its first use", 4096),)

WEIGHTS = PublishedWeights(
    "AlexNet",
    "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth",
    "7be5be791159472b1fbf3c69796f7cb30dca7ad8466c2df70058c37116cdee02",
    megabytes=244,
)
_CONV3 = 8  # the layers up to conv3 and its ReLU
_CONV3_NUMBERS = 384 * 13 * 13
_DIMENSION = 4096
_SEED = 0


def alexnet_features() -> nn.Sequential:
    """The convolutional part, (B, 3, 224, 224) to (B, 256, 6, 6): 2,469,696 parameters under torchvision's keys."""
    return nn.Sequential(
        nn.Conv2d(3, 64, 11, stride=4, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, stride=2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, stride=2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
        nn.MaxPool2d(3, stride=2),
    )


def prepare(argument: str, progress: Progress) -> None:
    """Fetches torchvision's weights, unless a file is given or they lie in the cache.

    Raises:
        MethodError: They cannot be fetched.
    """
    if not argument:
        fetch_weights(WEIGHTS, progress)


def open_method(argument: str) -> NetworkDescriber:
    """Opens AlexNet with the weights of a file, or with torchvision's.

    Raises:
        MethodError: The file is missing, damaged, or of another network.
    """
    with torch.device("meta"):
        features = alexnet_features()
    network = nn.ModuleDict({"features": features})
    digest = load_weights(weight_file(argument, WEIGHTS), network, WEIGHTS.network)
    projection = GaussianProjection(_CONV3_NUMBERS, _DIMENSION, _SEED)
    return NetworkDescriber(
        "alexnet",
        nn.Sequential(features[:_CONV3], nn.Flatten(), projection),
        settings={"layer": "conv3, after ReLU", "projection_seed": _SEED, "weights": digest[:16]},
        batch=32,
    )
