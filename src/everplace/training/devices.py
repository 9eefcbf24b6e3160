"""On which devices and machines a run trains, with which precision."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

import torch
from lightning_fabric import Fabric
from lightning_fabric.plugins.environments.lightning import LightningEnvironment
from torch import Tensor

from everplace.errors import ConfigError
from everplace.model.inference import default_device

__all__ = ["bf16_is_fast", "deterministic_training", "launch", "of_all_devices", "own_device", "require_devices"]

_WORKSPACE = "CUBLAS_WORKSPACE_CONFIG"


def bf16_is_fast(device: str) -> bool:
    """Whether the device multiplies bfloat16 in hardware; where it does not, autocast is many times slower."""
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    capabilities = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16") or capabilities.get("bf16"))


def require_devices(devices: int) -> None:
    """Makes sure that the machine has so many devices.

    Raises:
        ConfigError: It has fewer.
    """
    if torch.cuda.is_available() and devices > torch.cuda.device_count():
        raise ConfigError(
            f"`devices` {devices} was asked for, but this machine has {torch.cuda.device_count()}; give at most that"
        )


def own_device(processes: int) -> torch.device:
    """The device that this process trains on: each of several processes has its own.

    Args:
        processes: How many train the run together.
    """
    device = default_device()
    if device.type != "cuda":
        return device
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")) if processes > 1 else 0)


@contextmanager
def deterministic_training() -> Iterator[None]:
    """Has CUDA devices compute deterministically while it is open, and then undoes what that set for the whole process.

    cuBLAS's deterministic workspace is set, since torch looks for it at the first multiplication on a CUDA device; new
    tensors are not filled, a debugging aid of torch's deterministic mode.
    """
    workspace = os.environ.get(_WORKSPACE)
    enabled, warn = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    filling: Any = torch.utils.deterministic
    benchmark, fill = torch.backends.cudnn.benchmark, filling.fill_uninitialized_memory
    os.environ.setdefault(_WORKSPACE, ":4096:8")
    filling.fill_uninitialized_memory = False
    if default_device().type == "cuda":
        torch.backends.cudnn.benchmark = False
        torch.use_deterministic_algorithms(True, warn_only=True)
    try:
        yield
    finally:
        filling.fill_uninitialized_memory = fill
        torch.backends.cudnn.benchmark = benchmark
        torch.use_deterministic_algorithms(enabled, warn_only=warn)
        if workspace is None:
            os.environ.pop(_WORKSPACE, None)


def launch(devices: int, nodes: int, *, show: bool = False) -> Fabric:
    """Starts the processes of a run, one a device, and waits until all have met.

    Args:
        devices: Devices of each machine.
        nodes: Machines.
        show: Say what is waited for.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    device, processes = default_device().type, devices * nodes
    with _quiet_fabric():
        fabric = Fabric(
            accelerator=device,
            devices=devices,
            num_nodes=nodes,
            strategy="ddp" if processes > 1 else "auto",
            plugins=_alone() if processes == 1 else None,
            precision="bf16-mixed" if bf16_is_fast(device) else "32-true",
        )
        with _interruptible() if nodes > 1 else nullcontext():
            environment = getattr(fabric.strategy, "cluster_environment", None)
            if nodes > 1 and show and environment is not None and environment.global_rank() == 0:
                print(
                    f"everplace: waiting at {environment.main_address}:{environment.main_port} for all {processes} "
                    "processes; start the same command on the other machines, with MASTER_ADDR, MASTER_PORT and "
                    "NODE_RANK set; Ctrl-C ends it",
                    file=sys.stderr,
                    flush=True,
                )
            fabric.launch()
    return fabric


def of_all_devices(fabric: Fabric, *parts: Tensor) -> tuple[Tensor, ...]:
    """The rows of all devices, the same on each: (B, ...) each to (world × B, ...)."""
    if fabric.world_size == 1:
        return parts
    gathered: Any = fabric.all_gather(parts)
    return tuple(part.flatten(0, 1) for part in gathered)


def _alone() -> LightningEnvironment:
    """A run of one process, which is not part of the job of several that a cluster's variables may tell of."""
    environment = LightningEnvironment()
    environment.set_global_rank(0)  # it was taken from those variables
    return environment


@contextmanager
def _interruptible() -> Iterator[None]:
    """Lets Ctrl-C end the wait for processes on other machines, in which Python cannot answer it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    on_interrupt = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, on_interrupt)


@contextmanager
def _quiet_fabric() -> Iterator[None]:
    """Keeps Fabric's advice off the screen; what matters to the user is said by everplace."""
    logger = logging.getLogger("lightning_fabric")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="lightning_fabric.*")
            yield
    finally:
        logger.setLevel(level)
