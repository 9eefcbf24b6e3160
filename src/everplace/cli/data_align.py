"""`everplace data align`: the same stem for the same place in all drives of a route."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from everplace.choices import AlignedBy
from everplace.cli.options import Json, OutDirectory, RouteArgument
from everplace.cli.output import (
    require_directory,
    require_outside,
    require_picture,
    show_progress,
    show_result,
    warn,
)
from everplace.errors import ConfigError

__all__ = ["align"]


def align(
    route: RouteArgument,
    *,
    out: OutDirectory,
    by: Annotated[AlignedBy, typer.Option("--by", help="What tells the same places.")],
    radius: Annotated[
        float | None,
        typer.Option("--radius", metavar="METRES", help="Metres between two frames of a place [route.toml, else 10]."),
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option("--pairs", metavar="FILE.csv", help="Frames that show the same place, one column a traverse."),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option("--reference", metavar="TRAVERSE", help="Whose stems are kept [the one with the fewest frames]."),
    ] = None,
    method: Annotated[
        str, typer.Option("--method", metavar="METHOD", help="Describes the images, for --by images and --picture.")
    ] = "hog",
    picture: Annotated[
        Path | None,
        typer.Option("--picture", metavar="FILE.png", help="Draw the similarity of the drives and the path found."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a route in which the same stem means the same place; frames without a partner are left out.

    Example: everplace data align my-drives --by images --out my-route --picture path.png
    """
    if (by == "pairs") != (pairs is not None):
        raise ConfigError("--by pairs and --pairs FILE.csv go together; give both or none of them")
    if radius is not None and by != "poses":
        raise ConfigError(f"--radius is of no use with --by {by}; leave it out")
    require_directory(out)
    require_outside(out, route)
    if picture is not None:
        require_picture(picture, route, "--picture")
    from everplace.alignment.align import (
        align_by_images,
        align_by_pairs,
        align_by_poses,
        alignment_figure,
        judge,
    )
    from everplace.alignment.aligned_route import write_aligned
    from everplace.describe.registry import open_describer
    from everplace.files import require_free_directory
    from everplace.plots.canvas import save_figure
    from everplace.route.route import open_route

    require_free_directory(out)
    progress = show_progress()
    opened = open_route(route)
    if by == "images":
        alignment = align_by_images(opened, open_describer(method), reference, progress)
    elif pairs is not None:
        alignment = align_by_pairs(opened, pairs, reference)
    else:
        alignment = align_by_poses(opened, reference, radius)
    if picture is not None:
        if not alignment.paths:
            alignment = judge(alignment, open_describer(method), progress)
        save_figure(alignment_figure(alignment), picture)
    written = write_aligned(alignment, out, progress)
    result: dict[str, Any] = {
        "route": str(out),
        "places": alignment.places,
        "reference": alignment.reference,
        "by": alignment.how,
        "left_out": alignment.left_out,
        "unsure": {name: int(path.unsure.sum()) for name, path in alignment.paths.items()},
    }
    for sentence in (*alignment.warnings, *written.notes):
        warn(sentence)
    show_result(result, as_json)
