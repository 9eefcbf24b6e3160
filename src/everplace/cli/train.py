"""`everplace train`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from everplace.cli import options
from everplace.cli.option_groups import RouteOptions, TrainingOptions, grouped
from everplace.cli.options import only_given
from everplace.cli.output import (
    named_settings,
    require_directory,
    require_outside,
    show_progress,
    show_result,
)
from everplace.errors import ConfigError, StoppedError
from everplace.files import readable

__all__ = ["train"]


def _show_settings(model: str) -> None:
    """Prints all settings of a model and ends the command."""
    if model:
        from everplace.training.fitted_methods import FITTED_METHODS, settings_toml

        known = (*FITTED_METHODS, "best")
        if model not in known:
            raise ConfigError(f"--settings {model!r} is not known; choose {' or '.join(known)}")
        print(settings_toml(model))
        raise typer.Exit


@grouped
def train(
    route: options.RouteArgument,
    *,
    model: Annotated[str, typer.Option("--model", metavar="vae|c-vae|cp-vae|cae|fabmap", help="Which method to fit.")],
    out: options.OutDirectory,
    places: RouteOptions,
    training: TrainingOptions,
    recipe: Annotated[
        str,
        typer.Option("--recipe", metavar="faithful|best", help="The paper's bound alone, or CP-VAE with remedies."),
    ] = "",
    config: Annotated[
        Path | None,
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
    as_json: options.Json = False,
) -> None:
    """Fit a method on a route; RUN gets the checkpoint, config.toml and (of a network) metrics.csv.

    Example: everplace train my-route --model cp-vae --image-size 224 224 --epochs 40 --out runs/cp-vae
    """
    require_directory(out)
    require_outside(out, route)
    # Before torch is imported, which takes seconds.
    from everplace.route.route import open_route
    from everplace.training.select_route import require_places

    if config is None:
        places.selection()
        require_places(places.chosen(route), model)
    from everplace.settings import read_toml
    from everplace.training.fitted_methods import FITTED_METHODS, build_config, fit_method

    if model not in FITTED_METHODS:
        raise ConfigError(f"--model {model!r} is not known; choose {' or '.join(FITTED_METHODS)}")
    given = only_given(model=model, recipe=recipe, **{**asdict(places), "conditions": places.names})
    given |= training.given()
    values = (read_toml(config, f"--config {readable(config)}") if config is not None else {}) | given
    for length, other in (("epochs", "minutes"), ("minutes", "epochs")):
        if length in given:
            values.pop(other, None)
    if config is not None and values.keys() >= {"epochs", "minutes"}:
        raise ConfigError(f"--config {readable(config)} gives both epochs and minutes; keep one of them")
    with named_settings(given, config):
        checked = build_config(**values)

    from everplace.training.run_directory import leads, what_stands

    try:
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
    except KeyboardInterrupt:
        raise StoppedError(f"stopped; {what_stands(out)}") from None
    if leads(devices * nodes):
        show_result(asdict(summary), as_json)
