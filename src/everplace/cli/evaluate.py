"""`everplace evaluate`."""

from __future__ import annotations

import typer

from everplace.cli.options import (
    Database,
    DropDark,
    DropStationary,
    Frames,
    Json,
    Method,
    OutDirectory,
    Query,
    Radius,
    RouteArgument,
    Sequence,
    SequenceSearch,
    Standardise,
    Tolerance,
    selection_of,
)  # fmt: skip
from everplace.cli.output import (
    provenance,
    require_directory,
    require_outside,
    show_progress,
    show_result,
    warn_of_retrieval,
)

__all__ = ["evaluate", "register"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("evaluate")(evaluate)


def evaluate(
    route: RouteArgument,
    *,
    method: Method,
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
    require_directory(out)
    require_outside(out, route)
    from everplace.experiments.evaluation import evaluate_retrieval, write_evaluation
    from everplace.match.matching import Matching
    from everplace.route.route import open_route
    from everplace.scoring.retrieval import retrieve

    result = retrieve(
        open_route(route), query, database, method, tolerance=tolerance, radius=radius,
        selection=selection_of(frames, drop_dark, drop_stationary),
        matching=Matching(standardise, sequence, sequence_method), progress=show_progress(),
    )  # fmt: skip
    evaluation = evaluate_retrieval(result, method, show_progress())
    warn_of_retrieval(result, method, "Test on others with --frames")
    write_evaluation(evaluation, out, details=provenance())
    show_result(evaluation.metrics(), as_json)
