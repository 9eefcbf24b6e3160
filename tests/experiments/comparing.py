"""`everplace compare` as tests call it."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any, Literal

import torch

from everplace.cli import main
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig
from everplace.training.config import TrainConfig, write_config

OPTIONS = ("--methods", "sad,hog", "--frames", "2:", "--seed", "3")
"""Those of the comparison that tests share."""

MEASURED = ("ms_per_image", "measured_beside_other_work", "peak_memory_mb")
"""What of the metrics is measured by a clock or the system, and so differs from run to run."""


def compare(route: Path, out: Path, *options: str) -> dict[str, Any]:
    """Runs it and returns the content of metrics.json."""
    status, err = _call(route, out, *options)
    assert status == 0, err
    metrics: dict[str, Any] = json.loads((out / "metrics.json").read_text())
    return metrics


def refused(route: Path, out: Path, *options: str) -> str:
    """Runs it where it must fail, and returns the one sentence that says why."""
    status, err = _call(route, out, *options)
    assert status == 2, err
    (line,) = err.strip().splitlines()
    return line


def untrained_run(run: Path, kind: Literal["vae", "cae", "c-vae"] = "cae", **about: Any) -> Path:
    """A run directory with a small model that nobody trained, of which the checkpoint says `about`."""
    conditions = ("summer", "winter") if kind == "c-vae" else ()
    config = ModelConfig(kind=kind, height=32, width=32, conditions=conditions, fully_connected=False)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        model = ConditionVAE(config)
        model.initialise()
    save_checkpoint(run, model.eval(), about)
    write_config(run, TrainConfig.build(model=kind, epochs=1))
    return run


def _call(route: Path, out: Path, *options: str) -> tuple[int, str]:
    err = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        status = main.run(["compare", str(route), *options, "--out", str(out)])
    return status, err.getvalue()
