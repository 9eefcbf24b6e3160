"""A training run, from a route to a run directory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch
from pydantic import ValidationError

from everplace.errors import ConfigError
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import LABELLED_KINDS, ModelConfig
from everplace.progress import Progress, quiet
from everplace.route.route import Route
from everplace.settings import first_problem
from everplace.training.config import TrainConfig
from everplace.training.devices import deterministic_training, launch, own_device, require_devices
from everplace.training.display import Display, TrainingDisplay
from everplace.training.frames import SplitRoute, TrainingFrames, images_fingerprint, require_enough_frames, split_route
from everplace.training.freed_memory import freed_memory_kept
from everplace.training.loop import run_epochs
from everplace.training.place_projection import fit_place_projection
from everplace.training.resume_state import ResumeState, RunProgress, require_fitting
from everplace.training.run_directory import leads, locked_run, prepare_run, require_same_images, require_usable
from everplace.training.run_keeper import RunKeeper
from everplace.training.schedule import make_optimizer
from everplace.training.seen_images import seen_images
from everplace.training.select_route import select_route
from everplace.training.validation import criterion_name, validate

__all__ = ["TrainSummary", "require_trainable", "train"]


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
        held_out: Frames kept apart to choose the epoch by; between them and the training frames lies a gap.
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
    held_out: int
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
    show: bool | str = False,
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
        show: Show the training on stderr; text: under this name.

    Raises:
        RouteError: The route does not have what the model needs.
        ConfigError: The configuration is wrong, or `out` holds another run or is in use.
        CheckpointError: What should be resumed is damaged.
        DivergedError: Training met a number that is not finite.
        ImageError: A frame cannot be decoded.
        StorageError: The run directory cannot be written to.
    """
    processes = devices * nodes
    require_usable(out, config, resume, processes)
    require_devices(devices)
    chosen = require_trainable(route, config, progress)
    split = split_route(chosen, config, progress)
    frames = TrainingFrames(split, config.augmentation, config.batch_size, config.seed)
    frames.require_frames_per_device(processes)
    images = images_fingerprint(split, progress)
    with locked_run(out, processes), freed_memory_kept(), deterministic_training():
        state = prepare_run(out, config, resume, processes)
        if state is not None:
            require_same_images(state, images, out, route.root)
        reached = state.progress if state is not None else RunProgress()
        if not reached.finished:
            seen = seen_images(route, chosen, {*split.trained_stems, *split.held_out_stems}, progress)
            keeper = RunKeeper(out, config, split, images, seen, reached, save_every)
            model = _model(split, config, state, own_device(processes), progress)
            fabric = launch(devices, nodes, show=bool(show))
            optimizer = make_optimizer(model.to(fabric.device), config, state.optimizer if state is not None else None)
            measure = partial(validate, split=split, tolerance=config.tolerance, weights=config.weights)
            with _display(config, show if leads(processes) else False) as display:
                run_epochs(fabric, model, optimizer, frames, measure, config, keeper, display)
            reached = keeper.progress
            if fabric.is_global_zero:
                keeper.finish()
    return TrainSummary(
        run=str(out),
        model=config.model,
        recipe=config.recipe,
        remedies=tuple(config.remedies_in_use()),
        epochs=reached.epoch,
        seconds=reached.seconds,
        frames=frames.frames,
        places=split.places,
        held_out=sum(len(block.pixels) for block in split.held_out),
        conditions=split.conditions,
        criterion=criterion_name(split, config),
        best_epoch=reached.best_epoch,
        best_value=reached.best_value,
    )


def require_trainable(route: Route, config: TrainConfig, progress: Progress = quiet) -> Route:
    """Chooses what of a route a model is trained on, and checks it before the slow decoding.

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


def _model_config(conditions: tuple[str, ...], places: int, config: TrainConfig) -> ModelConfig:
    height, width = config.image_size
    try:
        return ModelConfig(
            kind=config.model,
            height=height,
            width=width,
            channels=1 if config.grey else 3,
            conditions=conditions if config.model in LABELLED_KINDS else (),
            places=places if config.model == "cp-vae" else 0,
            place_term=config.place_term,
            fully_connected=config.fully_connected,
            oriented_gradients=config.oriented_gradients,
        )
    except ValidationError as error:
        raise ConfigError(first_problem(error, ModelConfig).reason) from None


def _model(
    split: SplitRoute, config: TrainConfig, state: ResumeState | None, device: torch.device, progress: Progress
) -> ConditionVAE:
    """The network as the run stands: new, or with the weights of the state."""
    with torch.random.fork_rng():
        torch.manual_seed(config.seed)
        model = ConditionVAE(_model_config(split.conditions, split.places, config))
        if state is None:
            model.initialise()
    if state is not None:
        require_fitting(state, model)
        model.load_state_dict(state.model)
    elif config.oriented_gradients:
        fit_place_projection(model, split, config.projection, progress, device)
    return model


def _display(config: TrainConfig, show: bool | str) -> Display:
    return TrainingDisplay(config.epochs, show if isinstance(show, str) else "") if show else Display()
