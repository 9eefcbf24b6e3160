"""What an evaluation writes: metrics.json, the matches, pictures and report.html."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from everplace.experiments.captions import (
    match_caption,
    matching_words,
    matrix_caption,
    pair_words,
    right_words,
)
from everplace.experiments.evaluation import Evaluation
from everplace.experiments.latent_report import LATENT_PICTURES, audit_section, latent_section
from everplace.experiments.lead import evaluation_lead, sequence_sentence
from everplace.experiments.manifest import DEFINITIONS
from everplace.experiments.precision_section import precision_section
from everplace.experiments.recipe_names import named_method, named_recipe
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure, score_of, title_of
from everplace.experiments.trust import circular_sentence, seen_sentence, truth_source
from everplace.files import filled_directory, remove_file, write_json
from everplace.match.match_file import write_matches
from everplace.plots.canvas import save_figure
from everplace.plots.interactive_curves import precision_recall_figure
from everplace.report.html import Report, Section
from everplace.report.table_cells import Value
from everplace.scoring.retrieval import Retrieval

__all__ = ["write_evaluation"]

_METRICS = "metrics.json"


def write_evaluation(evaluation: Evaluation, out: Path, *, details: dict[str, str]) -> None:
    """Writes DIR/metrics.json, best_matches.csv, pictures and report.html, over those of an earlier evaluation.

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
    label, score = named_method(describer.method, evaluation.settings), score_of(result)
    title = title_of(result, label)
    matrix, gallery = matrix_figure(result, label), match_figure(result, label)
    save_figure(matrix, out / "similarity.png")
    save_figure(gallery, out / "matches.png")
    _write_best_matches(result, out / "best_matches.csv")
    right = "not aligned" if rule is None else right_words(rule)
    subtitle = f"{route.title}: {right}, {matching_words(result.matching)}"
    lead = evaluation_lead(result, label)
    report = Report(title, subtitle=subtitle, lead=lead, details={"method": evaluation.source, **details})
    section = report.section("Scores")
    if (recipe := named_recipe(evaluation.settings)) is not None:
        section.paragraph(f"This run is not the paper's model alone: {recipe}.")
    if evaluation.trained_places:
        section.paragraph(seen_sentence(describer.method, describer, evaluation.trained_places))
    if circular := circular_sentence(describer.method, describer, route, rule):
        section.paragraph(circular)
    if result.why_unscored:
        section.paragraph(f"There are no scores: {result.why_unscored}.")
    section.facts(_facts(evaluation))
    if result.scores is not None and result.frame_by_frame is not None:
        section.paragraph(sequence_sentence(result.matching, {label: result.frame_by_frame}, {label: result.scores}))
    if evaluation.image_time.beside_other_work:
        section.paragraph("The time for an image was measured beside other work, so it may be too high.")
    _curve(section, result, label)
    if result.precision_table is not None:
        precision_section(report.section("Choosing a threshold"), label, result.precision_table, score)
    report.section("Similarity matrix").figure(
        matrix,
        alt=f"Similarity of every query to every database frame: {title}.",
        caption=matrix_caption(result.query.name, result.database.name, rule, score),
    )
    report.section("Matches").figure(
        gallery,
        alt=f"Queries, the proposed frames{'' if rule is None else ' and the true ones'}: {title}.",
        caption=match_caption(rule, score),
        photos=True,
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


def _write_best_matches(result: Retrieval, path: Path) -> None:
    """Writes the best match of every query as `everplace match` does, under the same options of the match."""
    best = result.similarity.argmax(axis=1)[:, None]
    scores = np.take_along_axis(result.similarity, best, axis=1).astype(np.float32)
    kind = result.matching.score_kind(result.describer.metric)
    write_matches(path, result.query.stems, result.database.stems, best, scores, kind=kind)


def _curve(section: Section, result: Retrieval, label: str) -> None:
    """Adds the precision-recall curve, where there is one."""
    if result.curve is None:
        return
    asked, area = pair_words(result.query.name, result.database.name), result.curve.area
    section.chart(
        precision_recall_figure({label: result.curve}, areas={label: area}),
        alt=f"Precision-recall curve of {label}, {asked}: area {area:.3f}.",
        caption="Each query proposes its best database frame; the threshold sweeps over all distinct scores. The "
        "legend gives the area under the curve.",
    )


def _how(evaluation: Evaluation) -> list[list[Value]]:
    """What was evaluated, and a definition of each number of `_facts`."""
    result, source = evaluation.result, evaluation.source
    method, recipe = result.describer.method, named_recipe(evaluation.settings)
    told = {
        "method": source if source == method else f"{source} ({method}{f', {recipe}' if recipe else ''})",
        "query and database": f"Each of the {len(result.query):,} frames of the query {result.query.name} asks the "
        f"whole database {result.database.name}, {len(result.database):,} frames.",
        "right": "Nothing says which frames show the same place."
        if result.rule is None
        else f"A proposed frame counts as right {right_words(result.rule)}.",
        "truth": f"What is right is known from {truth_source(result.pair.route, result.rule)}.",
        "match": f"{matching_words(result.matching)}; score: {score_of(result)}",
        **{_long(name): _long(DEFINITIONS[name]) for name in (() if result.rule is None else _SCORES) + _COSTS},
    }
    return [[name, text] for name, text in told.items()]


_SCORES = ("curve", "recall@N", "auc_pr", "AP", "R@100%P", "EP")
_COSTS = ("dimension", "ms/image")
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


def _facts(evaluation: Evaluation) -> dict[str, float | int]:
    """The headline numbers of an evaluation."""
    result = evaluation.result
    scores = {} if result.scores is None else result.scores.columns()
    return {
        **{_long(name): score for name, score in scores.items()},
        "queries": len(result.query),
        "database": len(result.database),
        "dimension": result.describer.dimension,
        "ms per image": evaluation.image_time.ms,
    }
