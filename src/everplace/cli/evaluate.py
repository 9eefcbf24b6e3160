"""`everplace evaluate`."""

from __future__ import annotations

from everplace.cli import options
from everplace.cli.options import selection_of
from everplace.cli.output import (
    provenance,
    require_directory,
    require_outside,
    show_progress,
    show_result,
    warn_of_retrieval,
)

__all__ = ["evaluate"]


def evaluate(
    route: options.RouteArgument,
    *,
    method: options.Method,
    database: options.Database,
    query: options.Query,
    out: options.OutDirectory,
    frames: options.Frames = "",
    tolerance: options.Tolerance = None,
    radius: options.Radius = None,
    drop_dark: options.DropDark = False,
    drop_stationary: options.DropStationary = False,
    standardise: options.Standardise = None,
    sequence: options.Sequence = 1,
    sequence_method: options.SequenceSearch = "filter",
    as_json: options.Json = False,
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
