"""VGG19, pretrained on ImageNet: its fourth pooling layer or its second fully connected one.

Simonyan and Zisserman, "Very Deep Convolutional Networks for Large-Scale Image Recognition", ICLR 2015
(configuration E), with torchvision's weights; compared by cosine.

| method                | features                            | numbers | bytes a descriptor |
|-----------------------|-------------------------------------|---------|--------------------|
| `vgg19`, `vgg19:fc7`  | after the ReLU of fc7               | 4,096   | 16,384             |
| `vgg19:pool4`         | 512×14×14 of the fourth max-pooling | 100,352 | 401,408            |

A file of the same layout follows after a colon: `vgg19:pool4:FILE.pth`, `vgg19:FILE.pth`. fc7 is the default because a
route of pool4 fills the memory of a small machine: 6,400 frames are 2.6 GB.
"""

from __future__ import annotations

import torch
from torch import nn

from everplace.describe.pretrained.network import NetworkDescriber
from everplace.describe.pretrained.weights import PublishedWeights, fetch_weights, load_weights, weight_file
from everplace.errors import MethodError
from everplace.progress import Progress

__all__ = ["WEIGHTS", "open_method", "prepare", "vgg19_classifier", "vgg19_features"]

NOTES = (
    ("vgg19", "VGG19's fc7 trained on ImageNet (also vgg19:fc7)", "a download of 575 MB at its first use", 4096),
    ("vgg19:pool4", "VGG19's fourth pooling layer", "the same download, and 401 KB a frame", 100352),
)

WEIGHTS = PublishedWeights(
    "VGG19",
    "https://download.pytorch.org/models/vgg19-dcbb9e9d.pth",
    "dcbb9e9dad569fff7a846263a77324fc34978fea2bfb039c012d710e1776ae44",
    megabytes=575,
)
_LAYERS = ("fc7", "pool4")  # the first is the default
_BLOCKS = ((64, 64), (128, 128), (256,) * 4, (512,) * 4, (512,) * 4)
_POOL4 = 28  # the layers up to the fourth pooling


def vgg19_features() -> nn.Sequential:
    """The convolutional part, (B, 3, 224, 224) to (B, 512, 7, 7): 20,024,384 parameters under torchvision's keys."""
    layers: list[nn.Module] = []
    channels = 3
    for block in _BLOCKS:
        for width in block:
            layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU()]
            channels = width
        layers.append(nn.MaxPool2d(2, stride=2))
    return nn.Sequential(*layers)


def vgg19_classifier() -> nn.Sequential:
    """fc6 and fc7, (B, 25088) to (B, 4096), under torchvision's keys; dropout, which keeps its place, does nothing."""
    return nn.Sequential(nn.Linear(512 * 7 * 7, 4096), nn.ReLU(), nn.Dropout(), nn.Linear(4096, 4096), nn.ReLU())


def prepare(argument: str, progress: Progress) -> None:
    """Fetches torchvision's weights, unless a file is given or they lie in the cache.

    Raises:
        MethodError: They cannot be fetched.
    """
    if not _layer_and_file(argument)[1]:
        fetch_weights(WEIGHTS, progress)


def open_method(argument: str) -> NetworkDescriber:
    """Opens a layer of VGG19 with the weights of a file, or with torchvision's.

    Raises:
        MethodError: The file is missing, damaged, or of another network.
    """
    layer, file = _layer_and_file(argument)
    with torch.device("meta"):
        features, classifier = vgg19_features(), vgg19_classifier()
    used = {"features": features, "classifier": classifier} if layer == "fc7" else {"features": features}
    digest = load_weights(weight_file(file, WEIGHTS), nn.ModuleDict(used), WEIGHTS.network)
    stages = [features, nn.Flatten(), classifier] if layer == "fc7" else [features[:_POOL4], nn.Flatten()]
    return NetworkDescriber(
        f"vgg19:{layer}",
        nn.Sequential(*stages),
        settings={"weights": digest[:16]},
        batch=8,  # conv1 alone takes 13 MB an image
    )


def _layer_and_file(argument: str) -> tuple[str, str]:
    head, _, rest = argument.partition(":")
    if head in _LAYERS:
        return head, rest
    if argument and "/" not in argument and not argument.endswith(".pth"):
        raise MethodError(f"vgg19 has no layer {head!r}; choose {' or '.join(_LAYERS)}, or give a .pth file")
    return _LAYERS[0], argument
