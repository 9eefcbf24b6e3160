"""The run directory: made, or checked to be the run that is to be continued."""

from __future__ import annotations

import os
from pathlib import Path

from pydantic import ValidationError

from everplace.errors import CheckpointError, ConfigError
from everplace.files import readable
from everplace.model.checkpoint import CHECKPOINT_NAME
from everplace.model.tensor_file import has_tensors
from everplace.training.config import CONFIG_FILE, TrainConfig, read_toml, write_config
from everplace.training.state import RESUME, ResumeState, load_state

__all__ = ["leads", "prepare_run"]


def leads() -> bool:
    """Whether this process writes the run: with several devices, the first one on the first machine."""
    return int(os.environ.get("LOCAL_RANK", "0")) == 0 and int(os.environ.get("NODE_RANK", "0")) == 0


def prepare_run(out: Path, config: TrainConfig, resume: bool) -> ResumeState | None:
    """Makes the run directory, or checks that what stands there is this run.

    Args:
        out: The run directory.
        config: What is to be trained.
        resume: Continue what stands there.

    Returns:
        Where the run stands; None if it starts.

    Raises:
        ConfigError: `out` is a file, or holds another run.
        CheckpointError: What should be resumed is damaged.
        StorageError: The directory cannot be written to.
    """
    began = (out / CONFIG_FILE).is_file() or has_tensors(out, CHECKPOINT_NAME)
    if out.exists() and not out.is_dir():
        raise ConfigError(f"--out {readable(out)} is a file; name a directory for the run")
    if began and not resume and leads():
        raise ConfigError(f"--out {readable(out)} already holds a run; add --resume to continue it, or name another")
    if began and resume and (out / CONFIG_FILE).is_file():
        _require_same(out, config)
    state = load_state(out) if resume else None
    if leads():
        _remove_leftovers(out)
        write_config(out, config)
    return state


def _require_same(out: Path, config: TrainConfig) -> None:
    try:
        before = TrainConfig.model_validate(read_toml(out / CONFIG_FILE))
    except (ConfigError, ValidationError):
        raise CheckpointError(
            f"{readable(out / CONFIG_FILE)} was not written by this version of everplace or was altered; "
            "restore it, or train anew into another directory"
        ) from None
    for name in TrainConfig.model_fields:
        old, new = getattr(before, name), getattr(config, name)
        if old != new:
            raise ConfigError(
                f"--resume continues a run with its own settings, but {name} was {old!r} and is now {new!r}; give the "
                f"same, or another --out than {readable(out)}"
            )


def _remove_leftovers(out: Path) -> None:
    """Removes what a process that was killed had begun to write (see `files.whole_file`)."""
    for directory in (out, out / RESUME):
        for leftover in sorted(directory.glob(".*.part.*")):
            leftover.unlink(missing_ok=True)
