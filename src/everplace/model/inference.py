"""Where and how a network is applied: without gradients, in full float32 on every device."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import torch

from everplace.errors import MethodError

__all__ = ["default_device", "inference", "on_device"]

_asked: ContextVar[torch.device | None] = ContextVar("_asked", default=None)


def default_device() -> torch.device:
    """The device of `on_device`; outside it the CUDA device, where there is one, else the processor."""
    return _asked.get() or torch.device("cuda" if torch.cuda.is_available() else "cpu")


@contextmanager
def on_device(name: str | torch.device) -> Iterator[None]:
    """Makes a device the default one, for the networks that are opened meanwhile.

    Args:
        name: As torch calls it, such as "cpu" or "cuda:1".

    Raises:
        MethodError: It does not exist here.
    """
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # no such name, or a torch built without it
        raise MethodError(f"there is no device {str(name)!r} here; choose another, such as 'cpu'") from error
    token = _asked.set(device)
    try:
        yield
    finally:
        _asked.reset(token)


@contextmanager
def inference() -> Iterator[None]:
    """Applies networks while it is open, in full float32 and by cuDNN's deterministic algorithms on CUDA devices.

    By default convolutions keep 10 bits of a float32's mantissa there (TF32). Descriptors would then differ in the
    third digit from those of another machine and of the exported network. Several threads may have it open at once.
    """
    with torch.inference_mode():
        _exact.hold()
        try:
            yield
        finally:
            _exact.release()


class _Exact:
    """Settings of the whole process, changed as long as somebody holds them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders = 0
        self._before: list[tuple[Any, str, Any]] = []

    def hold(self) -> None:
        with self._lock:
            if not self._holders:
                settings = _settings()
                self._before = [(where, name, getattr(where, name)) for where, name, _ in settings]
                for where, name, value in settings:
                    setattr(where, name, value)
            self._holders += 1

    def release(self) -> None:
        with self._lock:
            self._holders -= 1
            if not self._holders:
                for where, name, value in self._before:
                    setattr(where, name, value)


def _settings() -> list[tuple[Any, str, Any]]:
    cudnn: Any = torch.backends.cudnn
    matmul: Any = torch.backends.cuda.matmul
    algorithms = [(cudnn, "deterministic", True), (cudnn, "benchmark", False)]
    if hasattr(cudnn, "conv") and hasattr(matmul, "fp32_precision"):
        # Since torch 2.9. To read the older switches fails for a caller who has set these.
        return [*((where, "fp32_precision", "ieee") for where in (cudnn.conv, cudnn.rnn, matmul)), *algorithms]
    return [(cudnn, "allow_tf32", False), (matmul, "allow_tf32", False), *algorithms]


_exact = _Exact()
