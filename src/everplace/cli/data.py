"""`everplace data`: routes on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from everplace.cli.data_align import align
from everplace.cli.data_fetch import fetch
from everplace.cli.data_import import import_, list_
from everplace.cli.data_inspect import inspect
from everplace.cli.options import AnySize, Grey, Json, OutDirectory, RouteArgument, split_names
from everplace.cli.output import (
    named_settings,
    require_directory,
    require_outside,
    show_progress,
    show_result,
)
from everplace.cli.registering import register

__all__ = ["app"]


def render(
    *,
    out: OutDirectory,
    places: Annotated[int, typer.Option("--places", min=2, help="Places along the route.")] = 200,
    image_size: AnySize = None,
    conditions: Annotated[
        str, typer.Option("--conditions", metavar="A,B", help="spring, summer, autumn, winter, night, rain [all].")
    ] = "",
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the world and the drives.")] = 0,
    image_format: Annotated[str, typer.Option("--format", metavar="png|jpg", help="Kind of image file.")] = "png",
    as_json: Json = False,
) -> None:
    """Render a route through a procedural world: the same places in several conditions, with their poses.

    Example: everplace data render --out my-route --places 200 --image-size 224 224
    """
    require_directory(out)
    from everplace.render.render_config import render_config
    from everplace.render.rendered_route import render_route
    from everplace.threads import usable_cores

    given: dict[str, Any] = {"places": places, "seed": seed, "format": image_format}
    if image_size is not None:
        given["size"] = image_size
    if conditions:
        given["conditions"] = split_names(conditions, "--conditions")
    with named_settings(given, called={"size": "image_size"}):
        config = render_config(given)
    render_route(out, config, progress=show_progress(), workers=usable_cores())
    show_result({"route": str(out), "traverses": list(config.conditions), "places": config.places}, as_json)


def pack(
    route: RouteArgument,
    image_size: AnySize = None,
    grey: Grey = False,
    cache: Annotated[
        Path | None,
        typer.Option("--cache", metavar="DIR", help="Where packs are kept [$EVERPLACE_CACHE, else the user's cache]."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Decode every frame of a route once, so that training on all of it starts at once.

    Example: everplace data pack my-route --image-size 224 224
    """
    if cache is not None:
        require_directory(cache, "--cache")
        require_outside(cache, route, "--cache")
    from everplace.images.decoding import ImageSpec
    from everplace.route.pack import pack as pack_traverse
    from everplace.route.route import open_route

    spec = ImageSpec(image_size or (224, 224), grey)
    opened = open_route(route)
    shapes = {
        traverse.name: list(pack_traverse(traverse, spec, cache=cache, progress=show_progress()).pixels.shape)
        for traverse in opened.traverses
    }
    show_result({"route": str(route), "packed": shapes}, as_json)


app = typer.Typer(help="Fetch, import, render, look at and pack routes.", no_args_is_help=True)
for _command in (render, pack, fetch, align, inspect):
    register(app, _command)
register(app, import_, "import")
register(app, list_, "list")
