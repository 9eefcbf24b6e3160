"""A network is applied with the same numbers everywhere, and torch is left as it was."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from everplace.model.inference import inference


def test_nothing_is_recorded_for_gradients_and_the_settings_come_back() -> None:
    cudnn = torch.backends.cudnn
    before = (cudnn.enabled, cudnn.benchmark, cudnn.deterministic, cudnn.allow_tf32)
    with inference():
        assert torch.is_inference_mode_enabled()
        assert (cudnn.benchmark, cudnn.deterministic, cudnn.allow_tf32) == (False, True, False)
    assert (cudnn.enabled, cudnn.benchmark, cudnn.deterministic, cudnn.allow_tf32) == before
    with pytest.raises(ValueError, match="stop"), inference():
        raise ValueError("stop")
    assert (cudnn.enabled, cudnn.benchmark, cudnn.deterministic, cudnn.allow_tf32) == before


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
def test_a_cuda_device_gives_what_the_processor_gives() -> None:
    generator = torch.Generator().manual_seed(0)
    network = nn.Sequential(*(nn.Conv2d(64, 64, 3, padding=1) for _ in range(4)))
    images = torch.randn(8, 64, 32, 32, generator=generator)
    with inference():
        expected = copy.deepcopy(network).double()(images.double())
        found = network.cuda()(images.cuda()).cpu()
    error = (found - expected).norm() / expected.norm()
    assert error < 1e-5
