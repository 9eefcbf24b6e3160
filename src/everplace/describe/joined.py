"""Several methods side by side, written with a plus: `hog16+efficientnet`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec, convert_image

__all__ = ["JoinedDescriber"]


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
