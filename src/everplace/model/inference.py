"""Where and how a network is applied: without gradients, with the same numbers on every device, but for rounding."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

__all__ = ["default_device", "inference"]


def default_device() -> torch.device:
    """The CUDA device, where there is one, else the processor."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


@contextmanager
def inference() -> Iterator[None]:
    """Applies networks in full float32 and by deterministic algorithms while it is open.

    By default convolutions on NVIDIA devices keep 10 bits of a float32's mantissa (TF32). Descriptors would then differ
    in the third digit from those of another machine and of the exported network.
    """
    cudnn = torch.backends.cudnn
    with (
        torch.inference_mode(),
        cudnn.flags(enabled=cudnn.enabled, benchmark=False, deterministic=True, allow_tf32=False),
    ):
        yield
