"""`everplace evaluate`."""

from __future__ import annotations

from typing import Annotated

import typer

from everplace.cli.options import (
    Database,
    DropDark,
    DropStationary,
    Frames,
    Json,
    OutDirectory,
    Query,
    Radius,
    RouteArgument,
    Sequence,
    SequenceSearch,
    Standardise,
    Tolerance,
)  # fmt: skip
from everplace.cli.output import (
    one_of,
    provenance,
    require_directory,
    require_outside,
    show_progress,
    show_result,
    warn,
)

__all__ = ["evaluate", "register"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("evaluate")(evaluate)


def evaluate(
    route: RouteArgument,
    method: Annotated[str, typer.Option("--method", metavar="METHOD", help="A run directory, or sad, hog, ...")],
    database: Database,
    query: Query,
    out: OutDirectory,
    frames: Frames = "",
    tolerance: Tolerance = None,
    radius: Radius = None,
    drop_dark: DropDark = False,
    drop_stationary: DropStationary = False,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    as_json: Json = False,
) -> None:
    """Score a method between two conditions; DIR gets metrics.json, pictures and report.html.

    Example: everplace evaluate my-route --method hog --database summer --query winter --frames 1620: --out result
    """
    how = one_of(standardise, "--standardise", ("centre", "full"))
    search = one_of(sequence_method, "--sequence-method", ("filter", "seqslam", "mean"))
    require_directory(out)
    require_outside(out, route)
    from everplace.experiments.evaluation import evaluate_method, seen_sentence, write_evaluation
    from everplace.route.route import open_route
    from everplace.route.selection import Selection, parse_frames
    from everplace.scoring.retrieval import Matching, Truth, of_itself_sentence

    evaluation = evaluate_method(
        open_route(route),
        method,
        query=query,
        database=database,
        selection=Selection(parse_frames(frames) if frames else None, drop_dark, drop_stationary),
        truth=Truth(tolerance, radius),
        matching=Matching(how, sequence, search),
        progress=show_progress(),
    )
    if evaluation.trained_places:
        warn(f"{seen_sentence(method, evaluation.trained_places)} Test on others with --frames")
    if evaluation.pair.of_itself:
        warn(of_itself_sentence(evaluation.pair))
    write_evaluation(evaluation, out, details=provenance())
    show_result(evaluation.metrics(), as_json)
