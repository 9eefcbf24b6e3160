"""`everplace evaluate`."""

from __future__ import annotations

from everplace.cli import options
from everplace.cli.option_groups import RetrievalOptions, grouped
from everplace.cli.output import (
    provenance,
    require_directory,
    require_outside,
    show_progress,
    show_result,
    warn_of_retrieval,
)

__all__ = ["evaluate"]


@grouped
def evaluate(
    route: options.RouteArgument, *, asked: RetrievalOptions, out: options.OutDirectory, as_json: options.Json = False
) -> None:
    """Score a method between two conditions; DIR gets metrics.json, best_matches.csv, pictures and report.html.

    Of drives that are not aligned nobody knows what is right: they get pictures and the scores of their best matches.

    Example: everplace evaluate my-route --method hog --database summer --query winter --frames 1620: --out result
    """
    require_directory(out)
    require_outside(out, route)
    result = asked.retrieve(route, show_progress())
    from everplace.experiments.evaluation import evaluate_retrieval
    from everplace.experiments.evaluation_report import write_evaluation

    evaluation = evaluate_retrieval(result, asked.method, show_progress())
    warn_of_retrieval(result, asked.method, "Test on others with --frames")
    write_evaluation(evaluation, out, details=provenance())
    show_result(evaluation.metrics(), as_json)
