"""A descriptor adapted to a route: another method's numbers, projected to what tells the route's places apart.

What `everplace adapt` writes. The projection is `everplace.adaptation.route_adaptation`'s; a run that was adapted is
copied into the directory, so that it holds all that describing needs.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
import tomli_w
import torch
from numpy.typing import NDArray
from torch import nn

from everplace.adaptation.discriminant import Projection
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Settings
from everplace.describe.registry import open_describer
from everplace.errors import CheckpointError
from everplace.files import readable, write_text
from everplace.tensor_file import load_tensors, save_tensors

__all__ = ["AdaptedDescriber", "open_method", "write_adapted"]

_FORMAT = 1
_NAME = "checkpoint"
_BASE = "base"


class AdaptedDescriber(Describer):
    """Describes with a method and an affine map of its numbers."""

    def __init__(
        self,
        base: Describer,
        projection: Projection,
        settings: Settings,
        seen_stems: frozenset[str] = frozenset(),
        seen_images: frozenset[str] = frozenset(),
    ) -> None:
        """Joins the two.

        Args:
            base: Gives F numbers an image.
            projection: (D, F).
            settings: What the map was made with.
            seen_stems: Frames of other drives that it was learnt from.
            seen_images: The same, by their content.
        """
        self.base = base
        self.projection = projection
        self.method = f"adapted {base.method}"
        self.image = base.image
        self.batch = base.batch
        self.dimension = len(projection.bias)
        self.seen_stems = seen_stems | base.seen_stems
        self.seen_images = seen_images | base.seen_images
        self._settings = settings
        self._weight = np.ascontiguousarray(projection.weight.T, np.float32)
        self._bias = projection.bias.astype(np.float32)
        self._digest = hashlib.sha256(self._weight.tobytes() + self._bias.tobytes()).hexdigest()[:16]

    def settings(self) -> Settings:
        """What the map was made with, a hash of its numbers, and the settings of the method below."""
        below = {f"base.{key}": value for key, value in self.base.settings().items()}
        return {**self._settings, "adapter": self._digest, **below}

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Describes B×H×W×C images by B×D numbers."""
        return self.project(self.base.describe_batch(images))

    def project(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Maps what the base says of images, B×F, to B×D."""
        return features @ self._weight + self._bias

    def network(self) -> nn.Module | None:
        """The network below with the map after it."""
        below = self.base.network()
        if below is None:
            return None
        mapped = nn.Linear(self._weight.shape[0], self.dimension)
        mapped.weight = nn.Parameter(torch.from_numpy(self._weight.T.copy()))
        mapped.bias = nn.Parameter(torch.from_numpy(self._bias))
        return nn.Sequential(below, mapped)


def write_adapted(out: Path, method: str, adapted: AdaptedDescriber, settings: Settings) -> None:
    """Writes an adapted descriptor as a run directory.

    Args:
        out: The directory, which exists.
        method: What was adapted; of a run directory the run is copied.
        adapted: The result.
        settings: What it was made with.

    Raises:
        StorageError: Writing failed.
    """
    if os.path.isfile(os.path.join(method, "config.toml")):  # noqa: PTH113, PTH118
        # `out` may lie in the run.
        left = shutil.ignore_patterns("resume", ".lock", "tensorboard", ".*.part")
        shutil.copytree(method, out / _BASE, ignore=left)
        method = ""
    tensors = {
        "weight": torch.from_numpy(adapted.projection.weight.astype(np.float32)),
        "bias": torch.from_numpy(adapted.projection.bias.astype(np.float32)),
    }
    about = {
        "format": _FORMAT, "model": {"kind": "adapted"}, "method": method, "features": adapted.base.dimension,
        "settings": dict(settings), "seen_stems": sorted(adapted.seen_stems),
        "seen_images": sorted(adapted.seen_images),
    }  # fmt: skip
    save_tensors(out, _NAME, tensors, about)
    write_text(out / "config.toml", tomli_w.dumps({"model": "adapted", **settings}))


def open_method(argument: str) -> AdaptedDescriber:
    """Opens a run directory.

    Raises:
        CheckpointError: It holds no usable adapted descriptor.
        MethodError: The method below cannot run here.
    """
    run = Path(argument)
    tensors, about = load_tensors(run, _NAME, _FORMAT)
    damaged = f"{readable(run)} is damaged; restore it, or adapt again"
    try:
        weight, bias = tensors["weight"].double().numpy(), tensors["bias"].double().numpy()
        method, features = about["method"], about["features"]
        stems, images = frozenset(map(str, about["seen_stems"])), frozenset(map(str, about["seen_images"]))
        settings = {str(key): value for key, value in about["settings"].items() if isinstance(value, str | int | float)}
    except (KeyError, TypeError, AttributeError):
        raise CheckpointError(damaged) from None
    fits = weight.ndim == 2 and len(weight) and weight.shape == (len(bias), features) and bias.ndim == 1
    known = isinstance(method, str) and (method or (run / _BASE / "config.toml").is_file())
    if not fits or not known:
        raise CheckpointError(damaged)
    base = open_describer(method or run / _BASE)
    if base.dimension != features:
        raise CheckpointError(
            f"{readable(run)} was made for {features} numbers, but {base.method} gives {base.dimension}; adapt again"
        )
    return AdaptedDescriber(base, Projection(weight, bias), settings, stems, images)
