"""Several methods side by side, written with a plus: `hog16+efficientnet`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec, convert_image

__all__ = ["JoinedDescriber"]


class _Part(nn.Module):
    """One part's network on images in [0, 1] of the whole: first to its own channels and size, as `convert_image` does.

    That rounds to whole numbers of 0 to 255 after each step. Grey is Pillow's, in 16-bit fixed point; halves of both
    sides are OpenCV's means of 2×2.
    """

    grey: Tensor

    def __init__(self, network: nn.Module, *, greys: bool, halves: bool) -> None:
        super().__init__()
        self.described, self._greys, self._halves = network, greys, halves
        self.register_buffer("grey", torch.tensor([19595.0, 38470.0, 7471.0])[:, None, None])

    def forward(self, images: Tensor) -> Tensor:
        if self._greys or self._halves:
            pixels = (images * 255).round()
            if self._greys:
                pixels = (((pixels * self.grey).sum(1, keepdim=True) + 32768) / 65536).floor()
            if self._halves:
                pixels = (functional.avg_pool2d(pixels, 2) + 0.5).floor()
            images = pixels / 255
        values: Tensor = self.described(images)
        length = values.square().mean(1, keepdim=True).sqrt()
        return values / torch.where(length > 0, length, 1.0)


class _SideBySide(nn.Module):
    """What all parts say of an image, one after the other."""

    def __init__(self, parts: Sequence[nn.Module]) -> None:
        super().__init__()
        self.parts = nn.ModuleList(parts)

    def forward(self, images: Tensor) -> Tensor:
        return torch.cat([part(images) for part in self.parts], 1)


class JoinedDescriber(Describer):
    """Describes with each part, scales what it says of an image to a mean square of 1, and puts it side by side.

    An image is decoded once, in the size of the largest part, and in colour where any part wants colour.
    """

    def __init__(self, parts: Sequence[Describer]) -> None:
        """Joins methods.

        Raises:
            MethodError: One of them is not compared by cosine, or has no size of its own.
        """
        sizes = []
        for part in parts:
            if part.metric != "cosine" or part.image.size is None:
                raise MethodError(
                    f"the method {part.method} cannot be joined with others: only methods that are compared by cosine "
                    "and take images of one size can"
                )
            sizes.append(part.image.size)
        self._parts = tuple(parts)
        self.method = "+".join(part.method for part in parts)
        self.image = ImageSpec(max(sizes, key=lambda size: size[0] * size[1]), grey=all(p.image.grey for p in parts))
        self.dimension = sum(part.dimension for part in parts)
        self.batch = min(part.batch for part in parts)
        self.seen_stems = frozenset().union(*(part.seen_stems for part in parts))
        self.seen_images = frozenset().union(*(part.seen_images for part in parts))

    def settings(self) -> Settings:
        """Returns those of the parts, each under its number."""
        return {
            f"{number}.{key}": value
            for number, part in enumerate(self._parts)
            for key, value in part.settings().items()
        }

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×C images by B×D values, of mean square 1 unless a part says nothing."""
        columns = []
        for part in self._parts:
            own = images if part.image == self.image else np.stack([convert_image(one, part.image) for one in images])
            values = part.describe_batch(own)
            length = np.sqrt(np.square(values).mean(axis=1, keepdims=True))
            columns.append(np.divide(values, length, out=np.zeros_like(values), where=length > 0))
        return np.concatenate(columns, axis=1)

    def network(self) -> nn.Module | None:
        """The networks of the parts side by side; None where a part is none.

        Raises:
            MethodError: A part is resized by another factor than one half.
        """
        networks = [part.network() for part in self._parts]
        whole = self.image.size
        assert whole is not None
        joined = []
        for part, network in zip(self._parts, networks, strict=True):
            if network is None:
                return None
            if part.image.size not in (whole, (whole[0] / 2, whole[1] / 2)):
                raise MethodError(
                    f"{self.method} cannot be a network: {part.method} resizes the image of {whole[0]}×{whole[1]} by "
                    "another factor than one half; export its parts alone"
                )
            greys = part.image.grey and not self.image.grey
            joined.append(_Part(network, greys=greys, halves=part.image.size != whole))
        return _SideBySide(joined)
