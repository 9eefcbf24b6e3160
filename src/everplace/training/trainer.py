"""How Lightning is driven: on which devices, with which precision, and without its advice on the screen."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import lightning
import torch
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.pytorch.loggers import Logger, TensorBoardLogger
from lightning.pytorch.trainer.states import TrainerStatus
from torch.utils.data import DataLoader

from everplace.errors import ConfigError
from everplace.model.inference import default_device
from everplace.training.callbacks import RunKeeper, TrainingDisplay
from everplace.training.config import TrainConfig
from everplace.training.frames import Batch, EpochOrder, TrainingFrames
from everplace.training.module import BoundModule
from everplace.training.prefetch import BatchesAhead
from everplace.training.resume_state import RunProgress

__all__ = [
    "GRADIENT_NORM",
    "bf16_is_fast",
    "make_loader",
    "make_trainer",
    "own_device",
    "require_devices",
    "run_trainer",
    "torch_settings_kept",
]

GRADIENT_NORM = 5.0
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
            f"--devices {devices} was asked for, but this machine has {torch.cuda.device_count()}; give at most that"
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
def torch_settings_kept() -> Iterator[None]:
    """Undoes what Lightning sets for the whole process: whether algorithms are deterministic, how they are chosen.

    While it is open, torch does not fill new tensors, a debugging aid of its deterministic mode; and cuBLAS's
    deterministic workspace is set, since torch looks for it at the first multiplication on a CUDA device, which may
    come before Lightning sets it.
    """
    workspace = os.environ.get(_WORKSPACE)
    os.environ.setdefault(_WORKSPACE, ":4096:8")
    enabled, warn = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    filling: Any = torch.utils.deterministic
    benchmark, fill = torch.backends.cudnn.benchmark, filling.fill_uninitialized_memory
    filling.fill_uninitialized_memory = False
    try:
        yield
    finally:
        filling.fill_uninitialized_memory = fill
        torch.backends.cudnn.benchmark = benchmark
        torch.use_deterministic_algorithms(enabled, warn_only=warn)
        if workspace is None:
            os.environ.pop(_WORKSPACE, None)


def make_trainer(
    config: TrainConfig, done: RunProgress, keeper: RunKeeper, out: Path, devices: int, nodes: int, *, show: bool | str
) -> lightning.Trainer:
    """Makes the trainer of a run.

    Args:
        config: The run's configuration.
        done: How far the run is.
        keeper: Saves and validates.
        out: The run directory, for the logs of TensorBoard, where it is installed.
        devices: Devices of each machine.
        nodes: Machines.
        show: Whether progress is shown; text: under this name.
    """
    device, processes = default_device().type, devices * nodes
    callbacks: list[lightning.Callback] = [keeper]
    if nodes > 1:
        callbacks.append(_Meeting(show=bool(show)))
    if show:
        callbacks.append(TrainingDisplay(keeper, config, show if isinstance(show, str) else ""))
    with _quiet_lightning():
        return lightning.Trainer(
            accelerator="gpu" if device == "cuda" else "cpu",
            devices=devices,
            num_nodes=nodes,
            strategy="ddp" if processes > 1 else "auto",
            plugins=_alone() if processes == 1 else None,
            precision="bf16-mixed" if bf16_is_fast(device) else "32-true",
            max_epochs=config.epochs - done.epoch if config.epochs is not None else -1,
            gradient_clip_val=GRADIENT_NORM,
            deterministic="warn" if device == "cuda" else False,
            logger=_tensorboard(out) or False,
            callbacks=callbacks,
            use_distributed_sampler=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )


def _alone() -> LightningEnvironment:
    """A run of one process, which is not part of the job of several that a cluster's variables may tell of."""
    environment = LightningEnvironment()
    environment.set_global_rank(0)  # Lightning took it from those variables, and keeps logs of rank 0 alone
    return environment


class _Meeting(lightning.Callback):
    """Lets Ctrl-C end the wait for processes on other machines, in which Python cannot answer it."""

    def __init__(self, *, show: bool) -> None:
        self._show = show
        self._on_interrupt: Any = None

    def wait(self, trainer: lightning.Trainer) -> None:
        """Says what is waited for, before the processes meet."""
        environment = getattr(trainer.strategy, "cluster_environment", None)
        if self._show and environment is not None and trainer.node_rank == trainer.local_rank == 0:
            where = f"{environment.main_address}:{environment.main_port}"
            print(
                f"everplace: waiting at {where} for all {trainer.world_size} processes; start the same command on the "
                "other machines, with MASTER_ADDR, MASTER_PORT and NODE_RANK set; Ctrl-C ends it",
                file=sys.stderr,
                flush=True,
            )
        if threading.current_thread() is threading.main_thread():
            self._on_interrupt = signal.signal(signal.SIGINT, signal.SIG_DFL)

    def setup(self, trainer: lightning.Trainer, pl_module: lightning.LightningModule, stage: str) -> None:
        """They have met."""
        self.end()

    def end(self) -> None:
        """Has Python answer Ctrl-C again."""
        if self._on_interrupt is not None:
            signal.signal(signal.SIGINT, self._on_interrupt)
            self._on_interrupt = None


def _tensorboard(out: Path) -> Logger | None:
    if find_spec("tensorboard") is None:
        return None
    return TensorBoardLogger(out, name="tensorboard", version="")


def make_loader(frames: TrainingFrames, order: EpochOrder) -> DataLoader[Batch] | BatchesAhead:
    """Makes what gives the batches of each epoch: ahead of the steps, where a device leaves the processor free.

    Args:
        frames: The training frames.
        order: In which they come.
    """
    if default_device().type == "cuda":
        return BatchesAhead(frames, order, pin=True)
    # On the CPU the network uses all cores itself; another thread would only take one away. The loader draws a seed for
    # workers each epoch, which it does not have: not from the caller's random numbers.
    return DataLoader(frames, batch_size=None, sampler=order, generator=torch.Generator())


def run_trainer(trainer: lightning.Trainer, module: BoundModule, frames: TrainingFrames, order: EpochOrder) -> None:
    """Trains a module to the end of its run.

    Args:
        trainer: Of `make_trainer`.
        module: What is trained.
        frames: The training frames.
        order: In which they come; shared out among the devices here.

    Raises:
        KeyboardInterrupt: Ctrl-C.
        DivergedError: Training met a number that is not finite.
    """
    order.share(trainer.global_rank, trainer.world_size)
    on_interrupt = signal.getsignal(signal.SIGINT)
    callbacks: list[lightning.Callback] = trainer.callbacks  # type: ignore[attr-defined]
    meetings = [callback for callback in callbacks if isinstance(callback, _Meeting)]
    try:
        with _quiet_lightning():
            for meeting in meetings:
                meeting.wait(trainer)
            trainer.fit(module, make_loader(frames, order))
    except SystemExit:
        # Lightning turns Ctrl-C into exit status 1, and has the process ignore the next one; the command line has its
        # own answer to it.
        if trainer.state.status == TrainerStatus.INTERRUPTED:
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, on_interrupt)
            raise KeyboardInterrupt from None
        raise
    finally:
        for meeting in meetings:  # also where they never met
            meeting.end()


@contextmanager
def _quiet_lightning() -> Iterator[None]:
    """Keeps Lightning's advice off the screen; what matters to the user is said by everplace."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="lightning.*")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
