"""Histograms of oriented gradients as a fixed layer: the fine structure that small convolutional nets lose."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from everplace.threads import one_torch_thread

__all__ = ["OrientedGradients", "gradient_features"]

SHORT_SIDE = 64
CELL = 8
DIRECTIONS = 16
_BLOCK = 8  # images at once, whose votes stay in a core's cache
_FLAT = 1e-4
"""Energy under which a neighbourhood counts as flat, so that noise is not blown up."""


class OrientedGradients(nn.Module):
    """Directions of the grey edges in a grid of cells, each cell normalised by its surroundings.

    After the histograms of oriented gradients of Dalal and Triggs (CVPR 2005), with directions over the full circle.
    Images are brought to a short side of 64; every pixel's gradient votes, by its length, for the directions within
    22.5 degrees of its own, and with linear weights for the cells of 8 pixels around it; each cell's 16 numbers are
    divided by the root mean energy of the 3×3 cells around it. This removes brightness and contrast, even
    where they vary across the image, before anything is learned.

    Nothing in it is learned, and no gradient goes through it.

    Attributes:
        features: Numbers an image: 16 × 8 × 16 for images twice as wide as high.
    """

    rows: Tensor
    columns: Tensor
    cell_rows: Tensor
    cell_columns: Tensor
    votes: Tensor

    def __init__(self, height: int, width: int) -> None:
        super().__init__()
        inner = [CELL * cells for cells in _grid(height, width)]
        matrices = {
            "rows": _resizing(height, inner[0]),
            "columns": _resizing(width, inner[1]),
            "cell_rows": _cells(inner[0]),
            "cell_columns": _cells(inner[1]),
            "votes": _votes(),
        }
        for name, matrix in matrices.items():
            self.register_buffer(name, torch.from_numpy(matrix.astype(np.float32)), persistent=False)
        self.features = gradient_features(height, width)

    @torch.no_grad()
    def forward(self, images: Tensor) -> Tensor:
        """Describes images.

        Args:
            images: (B, C, H, W) in [0, 1]; colour is averaged to grey.

        Returns:
            (B, features) float32, each at least 0, also under autocast: bfloat16 would round small gradients away.
        """
        with torch.autocast(images.device.type, enabled=False):
            if images.device.type != "cpu" or torch.compiler.is_exporting():
                return self._describe(images)
            # A block is done in less time than threads take to wait for each other where they share a core.
            with one_torch_thread():
                return torch.cat([self._describe(block) for block in torch.split(images, _BLOCK)])

    def _describe(self, images: Tensor) -> Tensor:
        grey = self.rows @ images.float().mean(1) @ self.columns.T
        padded = functional.pad(grey[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
        across = padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]
        down = padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]
        length = (across.square() + down.square()).sqrt()
        votes = functional.conv2d(torch.stack((across, down, length), 1), self.votes).relu()
        cells = self.cell_rows @ votes @ self.cell_columns.T
        energy = cells.square().sum(1, keepdim=True)
        around = functional.avg_pool2d(functional.pad(energy, (1, 1, 1, 1), mode="replicate"), 3, 1)
        return (cells / (around + _FLAT).sqrt()).flatten(1)


def gradient_features(height: int, width: int) -> int:
    """How many numbers `OrientedGradients` makes of an image, before anything is made for that size."""
    rows, columns = _grid(height, width)
    return DIRECTIONS * rows * columns


def _grid(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of cells."""
    scale = SHORT_SIDE / min(height, width)
    return max(1, round(height * scale / CELL)), max(1, round(width * scale / CELL))


def _votes() -> NDArray[np.float64]:
    """(16, 3, 1, 1): from (across, down, length) to the length's share above the edge of each direction's cone.

    For a gradient of length m at an angle t from the direction it is m (cos t - cos w) / (1 - cos w) with w the angle
    between directions; where that is negative the caller cuts it off.
    """
    angles = np.arange(DIRECTIONS) * 2 * math.pi / DIRECTIONS
    edge = math.cos(2 * math.pi / DIRECTIONS)
    rows = np.stack([np.cos(angles), np.sin(angles), np.full(DIRECTIONS, -edge)], axis=1) / (1 - edge)
    return rows[:, :, None, None]


def _resizing(given: int, wanted: int) -> NDArray[np.float64]:
    """(wanted, given): bilinear resizing of one side; where it shrinks, with a triangle as wide as needed."""
    centres = (np.arange(wanted) + 0.5) * given / wanted - 0.5
    reach = max(given / wanted, 1.0)
    weights = np.clip(1 - np.abs(np.arange(given) - centres.clip(0, given - 1)[:, None]) / reach, 0, None)
    normalised: NDArray[np.float64] = weights / weights.sum(axis=1, keepdims=True)
    return normalised


def _cells(side: int) -> NDArray[np.float64]:
    """(side / 8, side): linear weights of the pixels for the cells."""
    centres = (np.arange(side // CELL) + 0.5) * CELL - 0.5
    weights: NDArray[np.float64] = np.clip(1 - np.abs(np.arange(side) - centres[:, None]) / CELL, 0, None) / CELL
    return weights
