"""A method opened for use from Python: `everplace.load`."""

from __future__ import annotations

import os
from dataclasses import dataclass

from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.pipeline import describe_traverse
from everplace.describe.registry import open_describer
from everplace.progress import Progress, quiet
from everplace.route.traverse import Traverse

__all__ = ["Method", "load"]


@dataclass(frozen=True)
class Method:
    """An opened method.

    Attributes:
        describer: What describes batches of pixels.
    """

    describer: Describer

    def describe(self, traverse: Traverse, *, batch: int | None = None, progress: Progress = quiet) -> Descriptors:
        """Describes every frame of a traverse.

        Args:
            traverse: Such as `route["winter"]`.
            batch: Images described at once; None: what the method asks for, else 32.
            progress: Told of each image.

        Returns:
            N×D descriptors, named by the frames' stems.

        Raises:
            ImageError: A frame cannot be decoded.
        """
        return describe_traverse(self.describer, traverse, batch=batch, progress=progress)


def load(method: str | os.PathLike[str], *, progress: Progress = quiet) -> Method:
    """Opens a run directory or a method by name (`sad`, `hog`, ...).

    Args:
        method: See `everplace.describe.registry.open_describer`.
        progress: Told of what has to be downloaded first.

    Raises:
        MethodError: There is no such method, or it cannot run here.
        CheckpointError: The run directory is damaged.
    """
    return Method(open_describer(os.fspath(method), progress=progress))
