"""Describes RTAB-Map's images with everplace, as its global descriptor in Python.

EVERPLACE_METHOD names a method or a run directory of `everplace adapt` or `everplace train`; hog16 unless it is set:

    EVERPLACE_METHOD=runs/adapted rtabmap --Mem/GlobalDescriptorStrategy 1 --Kp/TfIdfLikelihoodUsed false \
        --PyDescriptor/Path integrations/rtabmap/everplace_descriptor.py --PyDescriptor/Dim 96

RTAB-Map calls `init` once with --PyDescriptor/Dim and `extract` for every image, and compares descriptors by their
scalar product (Signature::compareTo), so that they have length 1 here.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from everplace import Describer

__all__ = ["VARIABLE", "extract", "init"]

VARIABLE = "EVERPLACE_METHOD"
_describer: Describer | None = None
_failure = "init() was not called"


def init(descriptor_dim: int) -> None:
    """Opens the method; what is wrong with it is printed, and raised by `extract`.

    Args:
        descriptor_dim: D, RTAB-Map's --PyDescriptor/Dim.
    """
    global _describer, _failure  # noqa: PLW0603
    try:
        _describer = _opened(descriptor_dim)
    except Exception as error:  # which ends RTAB-Map where it is raised by init(), but not where by extract()
        _describer, _failure = None, str(error)
        print(f"everplace: {error}", file=sys.stderr)


def extract(image: NDArray[Any]) -> NDArray[np.float32]:
    """Describes an image.

    Args:
        image: H×W×1 (grey) or H×W×3 (BGR), 8 bits; RTAB-Map hands them over as signed ones.

    Returns:
        1×D, of length 1; 0 of an image that shows nothing.

    Raises:
        RuntimeError: The method could not be opened.
        everplace.errors.ImageError: The array is no image.
    """
    if _describer is None:
        raise RuntimeError(_failure)
    pixels = np.ascontiguousarray(np.asarray(image).view(np.uint8)[..., ::-1])
    values = _describer.describe(pixels).values
    length = float(np.linalg.norm(values.astype(np.float64)))
    return np.ascontiguousarray(values / length if length else values, np.float32)


def _opened(descriptor_dim: int) -> Describer:
    import everplace

    name = os.environ.get(VARIABLE) or "hog16"
    describer = everplace.load(name)
    if describer.metric != "cosine":
        raise ValueError(
            f"{VARIABLE}={name}: RTAB-Map compares descriptors by their scalar product, which {describer.method} is "
            "not made for; choose another method"
        )
    if describer.dimension != descriptor_dim:
        raise ValueError(
            f"{VARIABLE}={name} has {describer.dimension} numbers, but RTAB-Map expects {descriptor_dim}; give it "
            f"--PyDescriptor/Dim {describer.dimension}"
        )
    return describer
