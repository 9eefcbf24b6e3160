"""A network is applied with the same numbers everywhere, and torch is left as it was."""

from __future__ import annotations

import copy
import subprocess
import sys
import threading
from typing import Any

import pytest
import torch
from torch import nn

from everplace.model.inference import inference

cudnn: Any = torch.backends.cudnn
matmul: Any = torch.backends.cuda.matmul


def settings() -> tuple[Any, ...]:
    precisions = (cudnn.conv.fp32_precision, cudnn.rnn.fp32_precision, matmul.fp32_precision)
    return (*precisions, cudnn.enabled, cudnn.benchmark, cudnn.deterministic)


EXACT = ("ieee", "ieee", "ieee", True, False, True)


def test_nothing_is_recorded_for_gradients_and_the_settings_come_back() -> None:
    before = settings()
    assert before != EXACT
    with inference():
        assert torch.is_inference_mode_enabled()
        assert settings() == EXACT
    assert settings() == before
    with pytest.raises(ValueError, match="stop"), inference():
        raise ValueError("stop")
    assert settings() == before
    assert not torch.is_inference_mode_enabled()


@pytest.mark.parametrize(
    "first",
    [
        "cudnn.allow_tf32 = False",
        "cudnn.allow_tf32 = True",
        "cudnn.conv.fp32_precision = 'tf32'",
        "cudnn.conv.fp32_precision = 'ieee'",
        "torch.backends.fp32_precision = 'tf32'",
        "torch.backends.fp32_precision = 'ieee'",
        "torch.set_float32_matmul_precision('high')",
        "torch.set_float32_matmul_precision('medium')",
        "cudnn.benchmark = True",
    ],
)
@pytest.mark.slow
def test_whatever_the_caller_set_is_set_again(first: str) -> None:
    code = f"""
import torch
cudnn, matmul = torch.backends.cudnn, torch.backends.cuda.matmul
{first}
from everplace.model.inference import inference
def settings():
    precisions = (cudnn.conv.fp32_precision, cudnn.rnn.fp32_precision, matmul.fp32_precision)
    return (*precisions, cudnn.enabled, cudnn.benchmark, cudnn.deterministic)
before = settings()
with inference():
    assert settings() == {EXACT!r}, settings()
assert settings() == before, (settings(), before)
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_the_last_thread_puts_the_settings_back() -> None:
    before = settings()
    inside, leave = threading.Event(), threading.Event()

    def second() -> None:
        with inference():
            inside.set()
            leave.wait(30)

    with inference():
        thread = threading.Thread(target=second)
        thread.start()
        assert inside.wait(30)
    assert settings() == EXACT
    leave.set()
    thread.join()
    assert settings() == before


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
