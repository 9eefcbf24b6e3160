"""How pixels become a network's input, and back."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

__all__ = ["to_input", "to_pixels"]


def to_input(images: Tensor) -> Tensor:
    """Turns uint8 pixels (B, H, W, C) into float32 (B, C, H, W) in [0, 1]."""
    return images.permute(0, 3, 1, 2).to(torch.float32, memory_format=torch.contiguous_format).div_(255.0)


def to_pixels(images: Tensor) -> NDArray[np.uint8]:
    """Turns a decoder's mean (B, C, H, W) into uint8 pixels (B, H, W, C), clipped to the range."""
    scaled = images.detach().float().clamp(0.0, 1.0).mul(255.0).round().to(torch.uint8)
    pixels: NDArray[np.uint8] = scaled.permute(0, 2, 3, 1).contiguous().cpu().numpy()
    return pixels
