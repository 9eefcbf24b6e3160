"""Networks with random weights in the official layout; they show shapes and arithmetic, never results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeAlias

import pytest
import torch
from torch import Tensor, nn

SaveRandomWeights: TypeAlias = Callable[[Path, Mapping[str, nn.Module]], dict[str, Tensor]]


@pytest.fixture(scope="session")
def save_random_weights() -> SaveRandomWeights:
    """Writes a state dict of named parts, with weights that keep activations at one size, and returns it."""

    def save(path: Path, parts: Mapping[str, nn.Module]) -> dict[str, Tensor]:
        rng = torch.Generator().manual_seed(0)
        tensors: dict[str, Tensor] = {}
        for key, value in nn.ModuleDict(dict(parts)).state_dict().items():
            spread = (2 / value[0].numel()) ** 0.5 if value.ndim > 1 else 0.1
            tensors[key] = torch.randn(value.shape, generator=rng) * spread
        torch.save(tensors, path)
        return tensors

    return save
