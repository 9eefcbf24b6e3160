"""Gaussian random projection: far fewer numbers with nearly the same cosines."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace.threads import usable_cores

__all__ = ["GaussianProjection", "gaussian_matrix"]

_ROWS = 64


class GaussianProjection(nn.Module):
    """x to R x / √K with R of K×D independent standard normal numbers (Johnson and Lindenstrauss 1984).

    It keeps the cosine of two vectors up to an error of about (1 - cosine²) / √K. R is the same on every machine: it is
    drawn from PCG64 by the seed alone, 64 rows a stream, so that threads can share the work. It stays in memory: 4 K D
    bytes.

    Args:
        inputs: D.
        outputs: K.
        seed: Of the numbers.
    """

    matrix: Tensor

    def __init__(self, inputs: int, outputs: int, seed: int = 0) -> None:
        super().__init__()
        matrix = gaussian_matrix(inputs, outputs, seed)
        self.register_buffer("matrix", torch.from_numpy(matrix), persistent=False)
        self._scale = outputs**-0.5

    def forward(self, x: Tensor) -> Tensor:
        """(B, D) to (B, K)."""
        projected: Tensor = functional.linear(x, self.matrix) * self._scale
        return projected


def gaussian_matrix(inputs: int, outputs: int, seed: int) -> NDArray[np.float32]:
    """(outputs, inputs) independent standard normal numbers, the same on every machine (see `GaussianProjection`)."""
    matrix = np.empty((outputs, inputs), np.float32)

    def fill(start: int) -> None:
        numbers = np.random.Generator(np.random.PCG64([seed, start]))
        numbers.standard_normal(dtype=np.float32, out=matrix[start : start + _ROWS])

    with ThreadPoolExecutor(usable_cores(), "everplace-projection") as pool:
        list(pool.map(fill, range(0, outputs, _ROWS)))  # so that what a thread raises is raised
    return matrix
