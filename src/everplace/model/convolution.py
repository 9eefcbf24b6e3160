"""Convolutions whose small weight gradients in bfloat16 do not wait at a spinning barrier.

oneDNN's bfloat16 kernels share out the sum over a batch that is a weight's gradient, and their threads then wait for
each other in a loop that never gives up its core. Beside other work the thread that is waited for has none, so each
wait lasts until the scheduler takes the core away: at 64×32 in batches of 64, a gradient of 2 ms took 20 to 200. No
setting changes that loop, and a second core gains 0.1 to 0.8 ms there. So one thread sums up small gradients.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from everplace.threads import one_torch_thread

__all__ = ["Convolution", "TransposedConvolution"]

_SMALL = 2**22
"""Numbers of input and output together up to which one thread sums up: some 6 ms of work."""


class Convolution(nn.Conv2d):
    """`nn.Conv2d`, with the same weights and outputs."""

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) to (B, D, H', W')."""
        return _apply(self, x) if _waits(x) else super().forward(x)


class TransposedConvolution(nn.ConvTranspose2d):
    """`nn.ConvTranspose2d`, with the same weights and outputs."""

    def forward(self, x: Tensor, output_size: list[int] | None = None) -> Tensor:
        """(B, C, H, W) to (B, D, H', W')."""
        return _apply(self, x) if _waits(x) else super().forward(x, output_size)


def _waits(x: Tensor) -> bool:
    return x.device.type == "cpu" and torch.is_grad_enabled() and torch.is_autocast_enabled("cpu")


def _apply(layer: nn.Conv2d | nn.ConvTranspose2d, x: Tensor) -> Tensor:
    shape = (
        layer.stride,
        layer.padding,
        layer.dilation,
        isinstance(layer, nn.ConvTranspose2d),
        layer.output_padding,
        1,
    )
    weight = layer.weight.to(torch.bfloat16)
    bias = None if layer.bias is None else layer.bias.to(torch.bfloat16)
    with torch.autocast("cpu", enabled=False):
        output: Tensor = _Convolved.apply(x.to(torch.bfloat16), weight, bias, shape)  # type: ignore[no-untyped-call]
    return output


class _Convolved(torch.autograd.Function):
    """A convolution that computes the gradients of its input and of its weight one after the other."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor | None, shape: tuple[Any, ...]) -> Tensor:
        ctx.save_for_backward(x, weight)
        ctx.shape, ctx.biases = shape, None if bias is None else list(bias.shape)
        output: Tensor = torch.ops.aten.convolution(x, weight, bias, *shape)
        return output

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, weight = ctx.saved_tensors
        wants_input, *wants_weights, _ = ctx.needs_input_grad

        def gradients(*wanted: bool) -> tuple[Tensor | None, ...]:
            found: tuple[Tensor | None, ...] = torch.ops.aten.convolution_backward(
                gradient, x, weight, ctx.biases, *ctx.shape, wanted
            )
            return found

        of_input = gradients(True, False, False)[0] if wants_input else None
        if x.numel() + gradient.numel() <= _SMALL:
            with one_torch_thread():
                of_weights = gradients(False, *wants_weights)[1:]
        else:
            of_weights = gradients(False, *wants_weights)[1:]
        return of_input, *of_weights, None
