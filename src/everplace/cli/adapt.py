"""`everplace adapt`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from everplace.cli import options
from everplace.cli.option_groups import RouteOptions, grouped
from everplace.cli.output import (
    provenance,
    require_directory,
    require_file,
    require_outside,
    show_progress,
    show_result,
    warn,
)

if TYPE_CHECKING:
    from everplace.route.traverse import Traverse

__all__ = ["adapt"]


@grouped
def adapt(
    method: Annotated[str, typer.Argument(metavar="METHOD", help="hog16, or any other method or run directory.")],
    route: options.RouteArgument,
    *,
    out: options.OutDirectory,
    places: RouteOptions,
    dimensions: Annotated[int, typer.Option("--dimensions", min=1, metavar="D", help="Numbers of a descriptor.")] = 96,
    self_taught: Annotated[
        bool,
        typer.Option(
            "--self-taught", help="Match the drives after the first by itself, without believing their names."
        ),
    ] = False,
    prior: Annotated[
        str, typer.Option("--prior", metavar="default|none|FILE", help="What is known of how places change elsewhere.")
    ] = "default",
    teach_frames: Annotated[
        str, typer.Option("--teach-frames", metavar="A:B", help="Places of the later drives that teach [all].")
    ] = "",
    save_prior: Annotated[
        Path | None, typer.Option("--save-prior", metavar="FILE", help="Write what this route taught as a prior.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Adapt a descriptor to a route in seconds, from one drive or more; RUN is a method like any other.

    Example: everplace adapt hog16 my-route --conditions summer,winter --self-taught --out runs/adapted
    """
    from everplace.mapping.route_learning import adapt as adapt_descriptor
    from everplace.route.selection import parse_frames

    require_directory(out)
    require_outside(out, route)
    chosen = places.chosen(route)
    if places.names:  # the first one named is the map, whatever the order of the directories
        chosen = replace(chosen, traverses=tuple(sorted(chosen.traverses, key=lambda one: _named(one, places.names))))
    if save_prior is not None:
        require_file(save_prior, option="--save-prior")
    result = adapt_descriptor(
        method,
        chosen,
        out,
        dimensions=dimensions,
        self_taught=self_taught,
        prior=prior,
        selection=places.selection(),
        teach_frames=parse_frames(teach_frames, "--teach-frames") if teach_frames else None,
        save_prior=save_prior,
        details=provenance(),
        progress=show_progress(),
    )
    if result.describer.dimension < dimensions:
        warn(
            f"--dimensions {dimensions} was lowered to {result.describer.dimension}, as the map's "
            f"{result.settings['places']} different views do not allow more"
        )
    if prior == "default" and result.prior == "none":
        warn(f"no prior comes with everplace for {method}, so none was used")
    show_result(result.summary(), as_json)


def _named(traverse: Traverse, names: tuple[str, ...]) -> int:
    """The first of the names that a traverse goes by."""
    return next(index for index, name in enumerate(names) if name in (traverse.name, traverse.condition))
