"""Describes with a torch network that takes normalised images and gives one row an image."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.pretrained.network_input import IMAGENET, Normalisation, network_input
from everplace.describe.pretrained.trial import measured_dimension
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec
from everplace.model.inference import default_device, inference

__all__ = ["NetworkDescriber"]


class _Normalising(nn.Module):
    """A network with what `network_input` does to images in [0, 1] before it."""

    mean: Tensor
    std: Tensor

    def __init__(self, network: nn.Module, normalisation: Normalisation) -> None:
        super().__init__()
        self.described = network
        for name, values in (("mean", normalisation.mean), ("std", normalisation.std)):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32)[:, None, None])

    def forward(self, images: Tensor) -> Tensor:
        output = self.described((images - self.mean) / self.std)
        descriptors: Tensor = output[0] if isinstance(output, tuple | list) else output
        return descriptors


class NetworkDescriber(Describer):
    """A network as a method, for images in colour, on a GPU where there is one."""

    def __init__(
        self,
        method: str,
        network: nn.Module,
        *,
        settings: Settings,
        batch: int,
        size: tuple[int, int] = (224, 224),
        normalisation: Normalisation = IMAGENET,
    ) -> None:
        self.method = method
        self.image = ImageSpec(size)
        self.batch = batch
        self._normalisation = normalisation
        self._settings = {
            "height": size[0],
            "width": size[1],
            "mean": " ".join(map(str, normalisation.mean)),
            "std": " ".join(map(str, normalisation.std)),
            **settings,
        }
        self._device = default_device()
        self._network = network.to(self._device).eval().requires_grad_(False)
        self.dimension = measured_dimension(self, method, "try another size")

    def settings(self) -> Settings:
        """Returns image size, normalisation, and what the method itself states, its weights' hash among it."""
        return self._settings

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×3 images by B×D numbers.

        Raises:
            MethodError: The network returned something else.
        """
        pixels = torch.from_numpy(network_input(images, self._normalisation)).to(self._device)
        with inference():
            output = self._network(pixels)
        if isinstance(output, tuple | list) and output:  # such as BoQ's descriptors and attentions
            output = output[0]
        if not isinstance(output, Tensor) or not output.is_floating_point():
            what = f"a tensor of {output.dtype}" if isinstance(output, Tensor) else f"a {type(output).__name__}"
            raise MethodError(
                f"{self.method} returned {what} instead of one tensor of floating-point numbers; "
                "name an entry whose network returns the descriptors alone"
            )
        if output.ndim != 2 or len(output) != len(images):
            raise MethodError(
                f"{self.method} returned a tensor of shape {tuple(output.shape)} for {len(images)} images instead of "
                "one row an image; name an entry whose network returns B×D"
            )
        values: NDArray[np.float32] = output.float().cpu().numpy()
        return values

    def network(self) -> nn.Module:
        """The network with its normalisation."""
        return _Normalising(deepcopy(self._network).cpu(), self._normalisation)
