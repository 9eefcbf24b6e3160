"""A training run, from a route to a run directory."""

from __future__ import annotations

import logging
import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import lightning
import torch
from lightning.pytorch.loggers import Logger, TensorBoardLogger
from lightning.pytorch.trainer.states import TrainerStatus
from pydantic import ValidationError
from torch.utils.data import DataLoader

from everplace.data.images import usable_cores
from everplace.data.route import Route
from everplace.errors import ConfigError
from everplace.model.architecture import ConditionVAE
from everplace.model.config import ModelConfig
from everplace.progress import Progress, quiet
from everplace.training.callbacks import RunKeeper, TrainingDisplay
from everplace.training.config import TrainConfig
from everplace.training.frames import (
    Batch,
    EpochOrder,
    SplitRoute,
    TrainingFrames,
    fingerprint,
    require_enough_frames,
    split_route,
)
from everplace.training.module import BoundModule
from everplace.training.pairs import make_frames, make_order, require_shares
from everplace.training.place_projection import fit_place_projection
from everplace.training.remedies import RemedyTerms
from everplace.training.run_directory import locked, prepare_run, require_same_images, require_usable
from everplace.training.selection import select_route
from everplace.training.state import ResumeState, RunProgress, require_fitting, save_state
from everplace.training.validation import criterion_name

__all__ = ["GRADIENT_NORM", "TrainSummary", "bf16_is_fast", "require_trainable", "train"]

GRADIENT_NORM = 5.0


@dataclass(frozen=True, slots=True)
class TrainSummary:
    """What a run came to.

    Attributes:
        run: The run directory.
        model: Kind of the model.
        recipe: Name of the recipe.
        remedies: What the run has that the paper's model has not.
        epochs: Complete epochs.
        seconds: Training time.
        frames: Frames in the gradient.
        places: Training places; 0 if the traverses are not aligned.
        conditions: Names of the conditions.
        criterion: What chose the epoch.
        best_epoch: The epoch that the checkpoint holds.
        best_value: Its value of the criterion.
    """

    run: str
    model: str
    recipe: str
    remedies: tuple[str, ...]
    epochs: int
    seconds: float
    frames: int
    places: int
    conditions: tuple[str, ...]
    criterion: str
    best_epoch: int
    best_value: float | None


def train(
    route: Route,
    config: TrainConfig,
    out: Path,
    *,
    resume: bool = False,
    devices: int = 1,
    nodes: int = 1,
    save_every: float = 60.0,
    progress: Progress = quiet,
    show: bool = False,
) -> TrainSummary:
    """Trains a model and keeps its best epoch.

    A run of a given number of epochs that was killed at any moment and resumed ends with the same weights as one
    that was not, on the same machine: order, augmentation and noise depend on (seed, epoch, step) alone.

    Args:
        route: An opened route; the configuration chooses from it.
        config: Everything else that decides the outcome.
        out: The run directory, new or (with `resume`) one that this run began.
        resume: Continue where the run stands; start if there is nothing yet.
        devices: Devices on this machine; more than one train with DDP.
        nodes: Machines.
        save_every: At most so many seconds pass (and one epoch) between two states to resume from.
        progress: Told of decoding.
        show: Show the training on stderr.

    Raises:
        RouteError: The route does not have what the model needs.
        ConfigError: The configuration is wrong, or `out` holds another run or is in use.
        CheckpointError: What should be resumed is damaged.
        DivergedError: Training met a number that is not finite.
        StorageError: The run directory cannot be written to.
    """
    require_usable(out, config, resume)
    chosen = require_trainable(route, config, progress)
    split = split_route(chosen, config, progress)
    model_config = _model_config(split.conditions, split.places, config)
    frames = make_frames(split, config)
    _require_devices(devices)
    require_shares(split, config, devices * nodes)
    images = fingerprint(split, progress)
    with locked(out):
        state = prepare_run(out, config, resume)
        if state is not None:
            require_same_images(state, images, out, route.root)
        end = state.progress if state is not None else RunProgress()
        if not end.finished:
            keeper = RunKeeper(out, config, split, images, end, save_every)
            order = make_order(split, config, end.epoch)
            module = _module(model_config, config, len(order), split, state, progress)
            trainer = _trainer(config, end, keeper, devices, nodes, _tensorboard(out), show)
            order.share(trainer.global_rank, trainer.world_size)
            with _quiet_lightning():
                _run(trainer, module, _loader(frames, order))
            end = keeper.progress
            if trainer.is_global_zero:
                save_state(out, end.model_copy(update={"finished": True}), None, None, images)
    return TrainSummary(
        str(out), config.model, config.recipe, tuple(config.remedies_in_use()), end.epoch, end.seconds, len(frames),
        split.places, split.conditions, criterion_name(split, config), end.best_epoch, end.best_value,
    )  # fmt: skip


def require_trainable(route: Route, config: TrainConfig, progress: Progress = quiet) -> Route:
    """What of a route a model is trained on, before its frames are decoded, which may take hours.

    Args:
        route: An opened route; the configuration chooses from it.
        config: What is to be trained.
        progress: Told of the decoding that a filter needs.

    Raises:
        RouteError: The route does not have what the model needs.
        ConfigError: The conditions do not suit the model.
    """
    chosen = select_route(route, config, progress)
    _model_config(chosen.conditions, min(map(len, chosen.traverses)), config)
    require_enough_frames(chosen, config)
    return chosen


def bf16_is_fast(device: str) -> bool:
    """Whether the device multiplies bfloat16 in hardware; where it does not, autocast is many times slower."""
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    capabilities = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16") or capabilities.get("bf16"))


def _model_config(conditions: tuple[str, ...], places: int, config: TrainConfig) -> ModelConfig:
    height, width = config.image_size
    try:
        return ModelConfig(
            kind=config.model,
            height=height,
            width=width,
            channels=1 if config.grey else 3,
            conditions=conditions if config.model in ("c-vae", "cp-vae") else (),
            places=places if config.has_place_classes else 0,
            place_term=config.place_term,
            fully_connected=config.fully_connected,
            oriented_gradients=config.oriented_gradients,
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(first["msg"].removeprefix("Value error, ")) from None


def _require_devices(devices: int) -> None:
    if torch.cuda.is_available() and devices > torch.cuda.device_count():
        raise ConfigError(
            f"--devices {devices} was asked for, but this machine has {torch.cuda.device_count()}; give at most that"
        )


def _module(
    model_config: ModelConfig,
    config: TrainConfig,
    steps_per_epoch: int,
    split: SplitRoute,
    state: ResumeState | None,
    progress: Progress,
) -> BoundModule:
    with torch.random.fork_rng():
        torch.manual_seed(config.seed)
        model = ConditionVAE(model_config)
        if state is None:
            model.initialise()
        # After the model, whose random numbers are so the same without them.
        remedies = RemedyTerms(model_config, config.remedies)
    if state is None and config.oriented_gradients:
        fit_place_projection(model, split, config.projection, progress)
    done = state.progress if state is not None else RunProgress()
    if state is not None:
        require_fitting(state, model, remedies)
        model.load_state_dict(state.model)
        remedies.load_state_dict(state.remedies)
    return BoundModule(
        model,
        remedies,
        config,
        steps_per_epoch,
        first_epoch=done.epoch,
        seconds_before=done.seconds,
        has_checkpoint=done.best_epoch > 0,
        optimizer_state=state.optimizer if state is not None else None,
    )


def _trainer(
    config: TrainConfig,
    done: RunProgress,
    keeper: RunKeeper,
    devices: int,
    nodes: int,
    logger: Logger | None,
    show: bool,
) -> lightning.Trainer:
    device = "cuda" if torch.cuda.is_available() else "cpu"
    callbacks: list[lightning.Callback] = [keeper]
    if show:
        callbacks.append(TrainingDisplay(keeper, config))
    with _quiet_lightning():
        return lightning.Trainer(
            accelerator="gpu" if device == "cuda" else "cpu",
            devices=devices,
            num_nodes=nodes,
            strategy="ddp" if devices * nodes > 1 else "auto",
            precision="bf16-mixed" if bf16_is_fast(device) else "32-true",
            max_epochs=config.epochs - done.epoch if config.epochs is not None else -1,
            gradient_clip_val=GRADIENT_NORM,
            deterministic="warn" if device == "cuda" else False,
            logger=logger or False,
            callbacks=callbacks,
            use_distributed_sampler=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )


def _tensorboard(out: Path) -> Logger | None:
    if find_spec("tensorboard") is None:
        return None
    return TensorBoardLogger(out, name="tensorboard", version="")


def _loader(frames: TrainingFrames, order: EpochOrder) -> DataLoader[Batch]:
    # On the CPU the network uses all cores itself; a worker would only take one away.
    workers = min(8, usable_cores()) if torch.cuda.is_available() else 0
    # The loader draws a seed for its workers each epoch, which they do not use: not from the caller's random numbers.
    return DataLoader(
        frames, batch_size=None, sampler=order, num_workers=workers, persistent_workers=False,
        pin_memory=workers > 0, generator=torch.Generator(),
    )  # fmt: skip


def _run(trainer: lightning.Trainer, module: BoundModule, loader: DataLoader[Batch]) -> None:
    on_interrupt = signal.getsignal(signal.SIGINT)
    try:
        trainer.fit(module, loader)
    except SystemExit:
        # Lightning turns Ctrl-C into exit status 1, and has the process ignore the next one; the command line has its
        # own answer to it.
        if trainer.state.status == TrainerStatus.INTERRUPTED:
            if threading.current_thread() is threading.main_thread():
                signal.signal(signal.SIGINT, on_interrupt)
            raise KeyboardInterrupt from None
        raise


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
