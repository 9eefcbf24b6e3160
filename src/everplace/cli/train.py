"""`everplace train`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from everplace.cli.options import (
    DropDark,
    DropStationary,
    Epochs,
    Frames,
    Grey,
    ImageSize,
    Json,
    Minutes,
    OutDirectory,
    RouteArgument,
    Seed,
)  # fmt: skip
from everplace.cli.output import (
    named_settings,
    one_of,
    require_directory,
    require_one_length,
    require_outside,
    show_progress,
    show_result,
)
from everplace.errors import ConfigError
from everplace.files import readable

__all__ = ["register", "train"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("train")(train)


def _show_settings(model: str) -> None:
    """Prints all settings of a model and ends the command."""
    if model:
        from everplace.training.fitted_methods import FITTED_METHODS, settings_toml

        one_of(model, "--settings", (*FITTED_METHODS, "best"))
        print(settings_toml(model))
        raise typer.Exit


def train(
    route: RouteArgument,
    model: Annotated[str, typer.Option("--model", metavar="vae|c-vae|cp-vae|cae|fabmap", help="Which method to fit.")],
    out: OutDirectory,
    conditions: Annotated[
        str, typer.Option("--conditions", metavar="A,B", help="Traverses or conditions to train on [all].")
    ] = "",
    frames: Frames = "",
    image_size: ImageSize = None,
    grey: Grey = False,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    epochs: Epochs = None,
    minutes: Minutes = None,
    seed: Seed = None,
    recipe: Annotated[
        str, typer.Option("--recipe", help="faithful: the paper's bound alone; best: CP-VAE with remedies.")
    ] = "",
    config: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--config", metavar="FILE.toml", help="Settings; options given beside it count more."),
    ] = None,
    settings: Annotated[  # noqa: ARG001
        str,
        typer.Option(
            "--settings",
            metavar="MODEL|best",
            is_eager=True,
            callback=_show_settings,
            help="Print all settings of a model, or of the recipe best, as a file for --config, and stop.",
        ),
    ] = "",
    resume: Annotated[bool, typer.Option("--resume", help="Continue where the run in --out stands.")] = False,
    devices: Annotated[int, typer.Option("--devices", min=1, help="Devices on this machine (DDP).")] = 1,
    nodes: Annotated[int, typer.Option("--nodes", min=1, help="Machines (DDP).")] = 1,
    save_every: Annotated[
        float, typer.Option("--save-every", metavar="SECONDS", min=0, help="Time between states to resume from.")
    ] = 60.0,
    as_json: Json = False,
) -> None:
    """Fit a method on a route; RUN gets the checkpoint, config.toml and (of a network) metrics.csv.

    Example: everplace train my-route --model cp-vae --image-size 224 224 --epochs 40 --out runs/cp-vae
    """
    from everplace.settings import read_toml
    from everplace.training.fitted_methods import FITTED_METHODS, build_config, fit_method

    one_of(model, "--model", FITTED_METHODS)
    require_one_length(epochs, minutes)
    given: dict[str, Any] = {
        "conditions": tuple(name for name in conditions.split(",") if name) or None,
        "frames": frames or None,
        "image_size": image_size,
        "grey": grey or None,
        "drop_dark": drop_dark or None,
        "drop_stationary": drop_stationary or None,
        "epochs": epochs,
        "minutes": minutes,
        "seed": seed,
        "recipe": recipe or None,
    }
    options = {"model": model} | {key: value for key, value in given.items() if value is not None}
    values = (read_toml(config, f"--config {readable(config)}") if config is not None else {}) | options
    if epochs is not None and minutes is None:
        values.pop("minutes", None)
    if minutes is not None and epochs is None:
        values.pop("epochs", None)
    if config is not None and values.keys() >= {"epochs", "minutes"}:
        raise ConfigError(f"--config {readable(config)} gives both epochs and minutes; keep one of them")
    with named_settings(options, config):
        checked = build_config(**values)

    from everplace.route.route import open_route
    from everplace.training.run_directory import leads

    require_directory(out)
    require_outside(out, route)
    summary = fit_method(
        open_route(route),
        checked,
        out,
        resume=resume,
        devices=devices,
        nodes=nodes,
        save_every=save_every,
        progress=show_progress(),
        show=True,
    )
    if leads(devices * nodes):
        show_result(asdict(summary), as_json)
