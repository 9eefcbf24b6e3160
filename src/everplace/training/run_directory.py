"""The run directory: made, or checked to be the run that is to be continued."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from everplace.errors import CheckpointError, ConfigError, OtherRunError
from everplace.files import readable, remove_leftovers
from everplace.locking import locked
from everplace.model.checkpoint import CHECKPOINT_NAME
from everplace.settings import read_toml
from everplace.tensor_file import has_tensors
from everplace.training.config import CONFIG_FILE, FitConfig, write_config
from everplace.training.metrics_table import METRICS_FILE
from everplace.training.resume_state import RESUME, ResumeState, has_state, load_state

__all__ = ["leads", "locked_run", "prepare_run", "require_same_images", "require_usable", "what_stands"]

_RANKS = ("RANK", "SLURM_PROCID", "JSM_NAMESPACE_RANK", "GROUP_RANK", "NODE_RANK", "LOCAL_RANK")


_FORMER_REMEDIES = ("contrastive", "adversary", "swap", "conditional_prior", "free_bits")


def leads(processes: int = 1) -> bool:
    """Whether this process writes the run: of several, the first one on the first machine.

    Whoever starts the processes (torchrun, SLURM, LSF, Lightning itself) sets some of the ranks, which are all 0 in
    the first process alone. Ranks mean nothing to a run of one process: a SLURM job may be a sweep of such runs.

    Args:
        processes: How many train the run together, one a device.
    """
    return processes == 1 or all(int(os.environ.get(name) or 0) == 0 for name in _RANKS)


@contextmanager
def locked_run(out: Path, processes: int = 1) -> Iterator[None]:
    """Keeps other runs from writing into a run directory (see `everplace.locking.locked`).

    Args:
        out: The run directory.
        processes: How many train the run together; the first one of them has the lock.
    """
    with locked(out) if leads(processes) else nullcontext():
        yield


def require_usable(out: Path, config: FitConfig, resume: bool, processes: int = 1) -> None:
    """Makes sure that a run may be written to `out`, which is left as it is.

    Args:
        out: The run directory.
        config: What is to be trained.
        resume: Continue what stands there.
        processes: How many train the run together; to all but the first, what stands there is this run.

    Raises:
        ConfigError: `out` is a file, what the run writes in it cannot be written, or it holds another run
            (OtherRunError if it would be resumed).
        CheckpointError: The configuration of what should be resumed is damaged.
    """
    # A configuration alone, of a run that failed or was stopped in its first epoch, does not block a new run.
    began = has_tensors(out, CHECKPOINT_NAME) or has_state(out)
    if out.exists() and not out.is_dir():
        raise ConfigError(f"`out` {readable(out)} is a file; name a directory for the run")
    for name in (RESUME, "tensorboard"):
        if os.path.lexists(out / name) and not (out / name).is_dir():
            raise ConfigError(f"{readable(out / name)} is a file where the run needs a directory; remove it")
    for name in (CONFIG_FILE, METRICS_FILE, f"{CHECKPOINT_NAME}.json"):
        if os.path.lexists(out / name) and not (out / name).is_file():
            raise ConfigError(f"{readable(out / name)} is no file, which the run needs to write; remove it")
    if began and not resume and leads(processes):
        raise ConfigError(
            f"`out` {readable(out)} already holds a run; add `resume=True` to continue it, or name another"
        )
    if began and resume and (out / CONFIG_FILE).is_file():
        _require_same(out, config)


def prepare_run(out: Path, config: FitConfig, resume: bool, processes: int = 1) -> ResumeState | None:
    """Makes the run directory, or checks that what stands there is this run.

    Args:
        out: The run directory.
        config: What is to be trained.
        resume: Continue what stands there.
        processes: How many train the run together; the first one of them writes.

    Returns:
        Where the run stands; None if it starts.

    Raises:
        ConfigError: `out` is a file, or holds another run (OtherRunError if it would be resumed).
        CheckpointError: What should be resumed is damaged.
        StorageError: The directory cannot be written to.
    """
    require_usable(out, config, resume, processes)
    state = load_state(out) if resume else None
    if leads(processes):
        remove_leftovers(out, out / RESUME)
        write_config(out, config)
    return state


def what_stands(out: Path) -> str:
    """Says what a run that was stopped left, and how to go on."""
    if not out.is_dir():
        return "nothing was written; give the same command again"
    if not (has_state(out) or has_tensors(out, CHECKPOINT_NAME)):
        return (
            f"{readable(out)} holds the settings and no epoch yet, so the same command begins anew, with or without "
            "`resume=True`"
        )
    return f"the finished epochs stand in {readable(out)}; the same command with `resume=True` goes on from there"


def require_same_images(state: ResumeState, images: str, out: Path, route: Path) -> None:
    """Makes sure that what is continued, or is finished, was trained on these images.

    Args:
        state: Where the run stands; a state that does not know its images is let pass.
        images: Fingerprint of the images to train on (`frames.fingerprint`).
        out: The run directory.
        route: Where the images are from.

    Raises:
        OtherRunError: They are others.
    """
    if state.images and state.images != images:
        difference = f"was trained on other images than {readable(route)}"
        raise OtherRunError(
            f"`out` {readable(out)} {difference}; name another directory, or restore the images", difference
        )


def _require_same(out: Path, config: FitConfig) -> None:
    values: dict[str, Any] = {}
    try:
        values = read_toml(out / CONFIG_FILE)
        remedies = values.pop("remedies", None)  # a table that version 0.1 had
        before = type(config).model_validate(values)
    except (ConfigError, ValidationError) as error:
        if isinstance(error, ValidationError) and _of_another_method(error):
            raise _other_settings(out, "model", values["model"], config.model) from None
        raise CheckpointError(
            f"{readable(out / CONFIG_FILE)} was not written by this version of everplace or was altered; "
            "restore it, or train anew into another directory"
        ) from None
    used = [name for name in _FORMER_REMEDIES if isinstance(remedies, dict) and remedies.get(name)]
    if used:
        difference = f"was trained with remedies.{used[0]}, which this version does not have"
        raise OtherRunError(f"`out` {readable(out)} {difference}; name another directory to train without", difference)
    for name in type(config).model_fields:
        old, new = getattr(before, name), getattr(config, name)
        if old != new:
            raise _other_settings(out, name, old, new)


def _of_another_method(error: ValidationError) -> bool:
    """Whether a configuration does not fit because it is that of a method with other settings."""
    return any(one["loc"] == ("model",) and one["type"] == "literal_error" for one in error.errors())


def _other_settings(out: Path, name: str, old: object, new: object) -> OtherRunError:
    difference = f"{name} was {old!r} and is now {new!r}"
    return OtherRunError(
        f"`resume=True` continues a run with its own settings, but {difference}; give the same, or another `out` than "
        f"{readable(out)}",
        difference,
    )
