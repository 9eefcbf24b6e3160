"""`everplace compare`."""

from __future__ import annotations

from typing import Annotated

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
    Radius,
    RouteArgument,
    Seed,
    Sequence,
    SequenceSearch,
    Standardise,
    Tolerance,
)  # fmt: skip
from everplace.cli.output import one_of, provenance, require_directory, show_progress, show_result, warn

__all__ = ["compare", "register"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("compare")(compare)


def compare(
    route: RouteArgument,
    methods: Annotated[
        str,
        typer.Option(
            "--methods",
            metavar="A,B,...",
            help="Run directories, sad, hog, ..., or vae, c-vae, cp-vae, cae, fabmap to fit.",
        ),
    ],
    out: OutDirectory,
    frames: Frames = "",
    fit_frames: Annotated[
        str, typer.Option("--fit-frames", metavar="A:B", help="Places to fit methods on that must be fitted.")
    ] = "",
    conditions: Annotated[
        str, typer.Option("--conditions", metavar="A,B", help="Traverses or conditions to compare between [all].")
    ] = "",
    tolerance: Tolerance = None,
    radius: Radius = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    image_size: ImageSize = None,
    grey: Grey = False,
    epochs: Epochs = None,
    minutes: Minutes = None,
    seed: Seed = None,
    as_json: Json = False,
) -> None:
    """Compare methods on all ordered pairs of conditions; DIR gets metrics.json, table.md, pr_curves.png, report.html.

    Example: everplace compare my-route --methods cp-vae,sad,hog --fit-frames 0:800 --frames 820: --out result
    """
    how = one_of(standardise, "--standardise", ("centre", "full"))
    search = one_of(sequence_method, "--sequence-method", ("filter", "seqslam", "mean"))
    require_directory(out)
    from everplace.data.route import open_route
    from everplace.data.selection import Selection, parse_frames
    from everplace.experiments.comparison import compare_methods
    from everplace.experiments.comparison_report import write_comparison
    from everplace.experiments.evaluation import seen_places
    from everplace.experiments.fitting import fit_and_open
    from everplace.experiments.retrieval import Matching, Truth

    opened = open_route(route)
    names = tuple(name for name in conditions.split(",") if name)
    chosen = opened.choose(names) if names else opened
    selection = Selection(parse_frames(frames) if frames else None, drop_dark, drop_stationary)
    settings = {
        "image_size": image_size, "grey": grey or None, "seed": seed, "epochs": epochs, "minutes": minutes,
        "drop_dark": drop_dark or None, "drop_stationary": drop_stationary or None, "conditions": names or None,
    }  # fmt: skip
    tested, describers, left_out = fit_and_open(
        chosen,
        [name for name in methods.split(",") if name],
        selection,
        fit_frames,
        out,
        settings={key: value for key, value in settings.items() if value is not None},
        progress=show_progress(),
    )
    for label, describer in describers.items():
        if seen := seen_places(describer, tested):
            warn(f"{seen} of the tested places carry the names of places that {label} was trained on or chosen by")
    comparison = compare_methods(
        tested,
        describers,
        truth=Truth(tolerance, radius),
        matching=Matching(how, sequence, search),
        left_out=left_out,
        progress=show_progress(),
    )
    for method, reason in comparison.left_out.items():
        warn(f"{method} is left out: {reason}")
    write_comparison(comparison, out, title=f"Comparison on {opened.name}", details=provenance())
    if as_json:
        show_result(comparison.metrics(), as_json=True)
    else:
        print((out / "table.md").read_text("utf-8"), end="")
