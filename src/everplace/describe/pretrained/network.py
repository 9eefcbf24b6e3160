"""Describes with a torch network that takes normalised images and gives one row an image."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from everplace.describe.describer import Metric, require_images
from everplace.describe.pretrained.network_input import Normalisation, network_input
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec
from everplace.model.inference import default_device, inference

__all__ = ["NetworkDescriber"]


class NetworkDescriber:
    """A network as a method.

    Attributes:
        method: Its name.
        image: The image size; always colour.
        dimension: D.
        metric: Cosine similarity.
        batch: Images at once where nobody asks for another number, so that the activations of a large network fit into
            memory.
    """

    metric: Metric = "cosine"

    def __init__(
        self,
        method: str,
        network: nn.Module,
        *,
        size: tuple[int, int],
        normalisation: Normalisation,
        settings: Mapping[str, str | int | float | bool],
        batch: int,
        dimension: int | None = None,
        device: str | torch.device | None = None,
    ) -> None:
        self.method = method
        self.image = ImageSpec(size)
        self.batch = batch
        self._normalisation = normalisation
        self._settings = dict(settings)
        self._device = torch.device(device or default_device())
        self._network = network.to(self._device).eval().requires_grad_(False)
        self.dimension = self._measured_dimension() if dimension is None else dimension

    def settings(self) -> dict[str, str | int | float | bool]:
        """Returns image size, normalisation, and what the method itself states, its weights' hash among it."""
        assert self.image.size is not None
        return {
            "height": self.image.size[0],
            "width": self.image.size[1],
            "mean": " ".join(map(str, self._normalisation.mean)),
            "std": " ".join(map(str, self._normalisation.std)),
            **self._settings,
        }

    def describe(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×3 images by B×D numbers.

        Raises:
            MethodError: The network returned something else.
        """
        require_images(images, self.image, self.method)
        output = self._output(images)
        if output.shape[1] != self.dimension:
            raise MethodError(f"{self.method} returned {output.shape[1]} numbers an image, but {self.dimension} before")
        values: NDArray[np.float32] = output.float().cpu().numpy()
        return values

    def _output(self, images: NDArray[np.uint8]) -> Tensor:
        pixels = torch.from_numpy(network_input(images, self._normalisation)).to(self._device)
        with inference():
            output = self._network(pixels)
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
        return output

    def _measured_dimension(self) -> int:
        """D, learnt from one grey image, which also shows whether the network takes this size at all."""
        assert self.image.size is not None
        grey = np.full((1, *self.image.size, 3), 128, np.uint8)
        try:
            return int(self._output(grey).shape[1])
        except torch.OutOfMemoryError:
            raise
        except (RuntimeError, ValueError, AssertionError, TypeError, LookupError, AttributeError) as error:
            height, width = self.image.size
            reason = str(error).strip().splitlines() or [type(error).__name__]
            raise MethodError(
                f"{self.method} fails on an image of {height}×{width}: {reason[0]}; try another size"
            ) from error
