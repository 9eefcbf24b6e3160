"""`everplace evaluate`: one method on one pair of conditions, with its report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from everplace.audit.leakage import Audit, audit
from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.experiments.captions import (
    match_caption,
    match_note,
    matching_words,
    matrix_caption,
    pair_words,
    right_words,
    score_words,
)
from everplace.experiments.latent_report import LATENT_PICTURES, audit_section, latent_section
from everplace.experiments.manifest import DEFINITIONS
from everplace.experiments.recipe_names import ingredient_metrics, named_ingredients, named_method
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure
from everplace.files import filled_directory, remove_file, write_json
from everplace.match.standardise import require_standardisable
from everplace.plots.canvas import save_figure
from everplace.plots.interactive import precision_recall_figure
from everplace.progress import Progress, quiet
from everplace.report.blocks import Value
from everplace.report.html import Report
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.route.selection import Selection
from everplace.scoring.retrieval import Matching, Pair, Retrieval, Truth, choose_pair, retrieve, true_matches

__all__ = [
    "Evaluation",
    "audit_pair",
    "evaluate_method",
    "score_facts",
    "seen_places",
    "seen_sentence",
    "write_evaluation",
]


_METRICS = "metrics.json"
_AT_100 = "recall at 100 % precision"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One method on one pair.

    Attributes:
        route: The two traverses.
        pair: The same as query and database.
        truth: When a match is right.
        matching: Options of the match.
        result: Scores, curve and similarity.
        audit: The leakage audit; None unless the method is of the VAE family and the traverses are aligned.
        describer: The method.
        trained_places: Tested stems that the model was trained on or chosen by.
        source: The method as it was given, such as the path of a run.
    """

    route: Route
    pair: Pair
    truth: Truth
    matching: Matching
    result: Retrieval
    audit: Audit | None
    describer: Describer
    trained_places: int = 0
    source: str = ""

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json."""
        scores = self.result.scores.to_dict()
        return {
            "method": self.result.method,
            **ingredient_metrics(self.describer.settings()),
            "query_traverse": self.pair.query.name,
            "database_traverse": self.pair.database.name,
            "query_condition": self.pair.query.condition,
            "database_condition": self.pair.database.condition,
            "protocol": self.route.protocol,
            **scores,
            "tolerance": self.truth.tolerance,
            "radius": self.truth.radius,
            "truth": self.truth.pairs,
            **self.matching.metrics(),
            "dimension": self.result.dimension,
            "ms_per_image": round(self.result.ms_per_image, 4),
            "trained_places_tested": self.trained_places,
            **({"new_place": self.result.new_place} if self.result.new_place is not None else {}),
            **({"audit": self.audit.to_dict()} if self.audit is not None else {}),
        }


def evaluate_method(
    route: Route,
    method: str,
    *,
    query: str,
    database: str,
    selection: Selection,
    truth: Truth,
    matching: Matching,
    progress: Progress = quiet,
) -> Evaluation:
    """Evaluates a method between two conditions.

    Raises:
        RouteError: A condition does not exist, or nothing is left of the route.
        MethodError: The method does not exist or cannot run here.
        CheckpointError: The run directory is damaged.
        ConfigError: The method's descriptors cannot be standardised.
        ImageError: A frame cannot be decoded.
    """
    describer = open_describer(method, progress=progress)
    if matching.standardise is not None:
        require_standardisable(describer.method, describer.metric)
    chosen, pair = choose_pair(route, query, database, selection, progress)
    matches, truth = true_matches(chosen, pair, truth)
    result = retrieve(describer, pair, matches, matching, progress=progress)
    audited = audit_pair(describer, chosen, truth, progress)
    seen = seen_places(describer, chosen)
    return Evaluation(chosen, pair, truth, matching, result, audited, describer, seen, method)


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


def audit_pair(describer: Describer, route: Route, truth: Truth, progress: Progress = quiet) -> Audit | None:
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
    pair, result = evaluation.pair, evaluation.result
    asked = pair_words(pair.query.name, pair.database.name)
    label = named_method(result.method, evaluation.describer.settings())
    score = score_words(evaluation.describer.metric, evaluation.matching)
    note = match_note(evaluation.truth, score)
    title = f"{label}: {asked}"
    matrix = matrix_figure(pair, result, title=title, note=f"right: {right_words(evaluation.truth)}", score=score)
    gallery = match_figure(pair, result, title=title, note=note)
    save_figure(matrix, out / "similarity.png")
    save_figure(gallery, out / "matches.png")
    subtitle = f"{evaluation.route.title}: {right_words(evaluation.truth)}, {matching_words(evaluation.matching)}"
    report = Report(title, subtitle=subtitle, details={"method": evaluation.source, **details})
    section = report.section("Scores")
    named = named_ingredients(evaluation.describer.settings())
    if named is not None:
        section.paragraph(f"This run is not the paper's model alone: {named}.")
    if evaluation.trained_places:
        section.paragraph(seen_sentence(result.method, evaluation.trained_places))
    section.facts(score_facts(result))
    section.chart(
        precision_recall_figure({label: result.curve}, areas={label: result.scores.auc_pr}),
        alt=f"Precision-recall curve of {label}, {asked}: area {result.scores.auc_pr:.3f}.",
        caption="Each query proposes its best database frame; the threshold sweeps over all distinct scores. The "
        "legend gives the area under the curve.",
    )
    report.section("Similarity matrix").figure(
        matrix,
        alt=f"Similarity of every query to every database frame: {title}.",
        caption=matrix_caption(pair.query.name, pair.database.name, evaluation.truth, score),
    )
    report.section("Matches").figure(
        gallery,
        alt=f"Queries, the proposed frames and the true ones: {title}.",
        caption=match_caption(evaluation.truth, score),
    )
    if evaluation.audit is not None:
        audit_section(report.section("Leakage audit"), {label: evaluation.audit})
    pictures: list[str] = []
    model = evaluation.describer.latent_model
    if model is not None and evaluation.route.aligned:
        section = report.section("What the latent holds")
        pictures = latent_section(section, model, evaluation.route, out, label)
    section = report.section("How it was measured")
    section.table(["what", "definition"], _how(evaluation))
    report.write(out / "report.html")
    write_json(out / _METRICS, evaluation.metrics())
    return pictures


def _how(evaluation: Evaluation) -> list[list[Value]]:
    """What was evaluated, and a definition of each number of `score_facts`."""
    pair, settings = evaluation.pair, evaluation.describer.settings()
    named = named_ingredients(settings)
    method = f"{evaluation.source} ({evaluation.result.method}{f', {named}' if named else ''})"
    asked = (
        f"Each of the {len(pair.query):,} frames of the query {pair.query.name} asks the whole database "
        f"{pair.database.name}, {len(pair.database):,} frames."
    )
    told = {
        "method": method if evaluation.source != evaluation.result.method else evaluation.source,
        "query and database": asked,
        "right": f"A proposed frame counts as right {right_words(evaluation.truth)}.",
        "match": f"{matching_words(evaluation.matching)}; score: "
        f"{score_words(evaluation.describer.metric, evaluation.matching)}",
        # A definition may name another score as the tables of a comparison do.
        **{name: DEFINITIONS[known].replace("R@100%P", _AT_100) for name, known in _DEFINED.items()},
    }
    return [[name, text] for name, text in told.items()]


_DEFINED = {
    "curve": "curve",
    "recall@N": "recall@N",
    "auc_pr": "auc_pr",
    "average precision": "AP",
    _AT_100: "R@100%P",
    "extended precision": "EP",
    "dimension": "dimension",
    "ms per image": "ms/image",
}
"""The names of `score_facts`, and those of the definitions."""


def score_facts(result: Retrieval) -> dict[str, float | int]:
    """The headline numbers of a retrieval."""
    scores = result.scores
    return {
        "recall@1": scores.recall_at["1"],
        "recall@5": scores.recall_at["5"],
        "recall@10": scores.recall_at["10"],
        "auc_pr": scores.auc_pr,
        "average precision": scores.average_precision,
        _AT_100: scores.recall_at_100_precision,
        "extended precision": scores.extended_precision,
        "queries": scores.queries,
        "database": scores.database,
        "dimension": result.dimension,
        "ms per image": result.ms_per_image,
    }
