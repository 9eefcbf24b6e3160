"""`everplace evaluate`: one method on one pair of conditions, with its report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from everplace.audit.leakage import Audit, audit
from everplace.describe.costs import time_describer
from everplace.describe.describer import Describer
from everplace.experiments.captions import (
    match_caption,
    matching_words,
    matrix_caption,
    pair_words,
    right_words,
)
from everplace.experiments.latent_report import LATENT_PICTURES, audit_section, latent_section
from everplace.experiments.manifest import DEFINITIONS
from everplace.experiments.recipe_names import named_method, named_recipe, recipe_metrics
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure, score_of, title_of
from everplace.files import filled_directory, remove_file, write_json
from everplace.plots.canvas import save_figure
from everplace.plots.interactive_curves import precision_recall_figure
from everplace.progress import Progress, quiet
from everplace.report.html import Report
from everplace.report.table_cells import Value
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.scoring.retrieval import MatchRule, Retrieval

__all__ = [
    "Evaluation",
    "audit_pair",
    "evaluate_retrieval",
    "score_facts",
    "seen_places",
    "seen_sentence",
    "write_evaluation",
]


_METRICS = "metrics.json"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One method on one pair.

    Attributes:
        result: Scores, curve and similarity.
        audit: The leakage audit; None unless the method is of the VAE family and the traverses are aligned.
        ms_per_image: Description alone, see `everplace.describe.costs.time_describer`.
        trained_places: Tested stems that the model was trained on or chosen by.
        source: The method as it was given, such as the path of a run.
    """

    result: Retrieval
    audit: Audit | None
    ms_per_image: float
    trained_places: int
    source: str

    @property
    def settings(self) -> Mapping[str, Any]:
        """Those of the method."""
        return self.result.describer.settings()

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json."""
        result = self.result
        return {
            "method": result.describer.method,
            **recipe_metrics(self.settings),
            "query_traverse": result.query.name,
            "database_traverse": result.database.name,
            "query_condition": result.query.condition,
            "database_condition": result.database.condition,
            "protocol": result.pair.route.protocol,
            **result.scores.to_dict(),
            **result.rule.metrics(),
            **result.matching.metrics(),
            "dimension": result.describer.dimension,
            "ms_per_image": round(self.ms_per_image, 4),
            "trained_places_tested": self.trained_places,
            **({"new_place": result.new_place} if result.new_place is not None else {}),
            **({"audit": self.audit.to_dict()} if self.audit is not None else {}),
        }


def evaluate_retrieval(result: Retrieval, source: str, progress: Progress = quiet) -> Evaluation:
    """Adds to the scores what a report says of the method: its speed, its audit, what it had seen.

    Args:
        result: See `everplace.scoring.retrieval.retrieve`.
        source: The method as it was given, such as the path of a run.
        progress: Told of the decoding that the audit needs.

    Raises:
        ImageError: A frame cannot be decoded.
    """
    describer, route = result.describer, result.pair.route
    return Evaluation(
        result=result,
        audit=audit_pair(describer, route, result.rule, progress),
        ms_per_image=time_describer(describer, result.query.paths),
        trained_places=seen_places(describer, route),
        source=source,
    )


def seen_places(describer: Describer, route: Route) -> int:
    """How many of a route's stems a model was trained on or chosen by: the scores are no test of these."""
    stems = {stem for traverse in route.traverses for stem in traverse.stems}
    return len(stems & describer.seen_stems)


def seen_sentence(label: str, count: int) -> str:
    """Says that the scores of a method are no test of `count` places."""
    return (
        f"{count} of the tested places carry the names of places that {label} was trained on or chosen by: if it is "
        "the same route, its scores say how well it remembers them, not how well it recognises."
    )


def audit_pair(describer: Describer, route: Route, truth: MatchRule, progress: Progress = quiet) -> Audit | None:
    """The leakage audit on the places that all traverses of a route share; None where it has no meaning."""
    shared = route.shared_stems()
    model = describer.latent_model
    if model is None or len(route.traverses) < 2 or len(shared) < 4:
        return None
    route = route.at(shared)
    pixels = [pack(traverse, describer.image, progress=progress).pixels for traverse in route.traverses]
    return audit(
        model,
        pixels,
        truth.tolerance if truth.tolerance is not None else 1,
        conditions=[traverse.condition for traverse in route.traverses],
    )


def write_evaluation(evaluation: Evaluation, out: Path, *, details: dict[str, str]) -> None:
    """Writes DIR/metrics.json, the pictures and report.html, over those of an earlier evaluation.

    Raises:
        StorageError: Writing failed; what stood in DIR stands as it was.
    """
    with filled_directory(out) as directory:
        pictures = _fill(directory, evaluation, details)
        if (out / _METRICS).is_file():  # of an earlier evaluation, perhaps of another method
            for name in set(LATENT_PICTURES) - set(pictures):
                remove_file(out / name)


def _fill(out: Path, evaluation: Evaluation, details: dict[str, str]) -> list[str]:
    """Writes the files of an evaluation, and returns the names of the pictures of the latent."""
    result = evaluation.result
    describer, route, rule = result.describer, result.pair.route, result.rule
    asked = pair_words(result.query.name, result.database.name)
    label, score = named_method(describer.method, evaluation.settings), score_of(result)
    title = title_of(result, label)
    matrix, gallery = matrix_figure(result, label), match_figure(result, label)
    save_figure(matrix, out / "similarity.png")
    save_figure(gallery, out / "matches.png")
    subtitle = f"{route.title}: {right_words(rule)}, {matching_words(result.matching)}"
    report = Report(title, subtitle=subtitle, details={"method": evaluation.source, **details})
    section = report.section("Scores")
    if (recipe := named_recipe(evaluation.settings)) is not None:
        section.paragraph(f"This run is not the paper's model alone: {recipe}.")
    if evaluation.trained_places:
        section.paragraph(seen_sentence(describer.method, evaluation.trained_places))
    section.facts(score_facts(evaluation))
    section.chart(
        precision_recall_figure({label: result.curve}, areas={label: result.scores.auc_pr}),
        alt=f"Precision-recall curve of {label}, {asked}: area {result.scores.auc_pr:.3f}.",
        caption="Each query proposes its best database frame; the threshold sweeps over all distinct scores. The "
        "legend gives the area under the curve.",
    )
    report.section("Similarity matrix").figure(
        matrix,
        alt=f"Similarity of every query to every database frame: {title}.",
        caption=matrix_caption(result.query.name, result.database.name, rule, score),
    )
    report.section("Matches").figure(
        gallery,
        alt=f"Queries, the proposed frames and the true ones: {title}.",
        caption=match_caption(rule, score),
    )
    if evaluation.audit is not None:
        audit_section(report.section("Leakage audit"), {label: evaluation.audit})
    pictures: list[str] = []
    model = describer.latent_model
    if model is not None and route.aligned:
        pictures = latent_section(report.section("What the latent holds"), model, route, out, label)
    report.section("How it was measured").table(["what", "definition"], _how(evaluation))
    report.write(out / "report.html")
    write_json(out / _METRICS, evaluation.metrics())
    return pictures


def _how(evaluation: Evaluation) -> list[list[Value]]:
    """What was evaluated, and a definition of each number of `score_facts`."""
    result, source = evaluation.result, evaluation.source
    method, recipe = result.describer.method, named_recipe(evaluation.settings)
    told = {
        "method": source if source == method else f"{source} ({method}{f', {recipe}' if recipe else ''})",
        "query and database": f"Each of the {len(result.query):,} frames of the query {result.query.name} asks the "
        f"whole database {result.database.name}, {len(result.database):,} frames.",
        "right": f"A proposed frame counts as right {right_words(result.rule)}.",
        "match": f"{matching_words(result.matching)}; score: {score_of(result)}",
        "curve": DEFINITIONS["curve"],
        "recall@N": DEFINITIONS["recall@N"],
        **{_long(name): _long(DEFINITIONS[name]) for name in _DEFINED},
    }
    return [[name, text] for name, text in told.items()]


_DEFINED = ("auc_pr", "AP", "R@100%P", "EP", "dimension", "ms/image")
_LONG = {
    "AP": "average precision",
    "R@100%P": "recall at 100 % precision",
    "EP": "extended precision",
    "ms/image": "ms per image",
}
"""What is short in the tables of a comparison has room in the report of one method."""


def _long(text: str) -> str:
    """A name of a score, or a definition that names another one."""
    return _LONG.get(text, text.replace("R@100%P", _LONG["R@100%P"]))


def score_facts(evaluation: Evaluation) -> dict[str, float | int]:
    """The headline numbers of an evaluation."""
    scores = evaluation.result.scores
    return {
        **{_long(name): score for name, score in scores.columns().items()},
        "queries": scores.queries,
        "database": scores.database,
        "dimension": evaluation.result.describer.dimension,
        "ms per image": evaluation.ms_per_image,
    }
