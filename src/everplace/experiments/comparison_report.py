"""What a comparison writes when all is scored: metrics.json, table.md, pr_curves.png and report.html."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from everplace.experiments.captions import (
    match_caption,
    matching_words,
    matrix_caption,
    pair_words,
    right_words,
)
from everplace.experiments.comparison import COSTS, SCORES, Cell, Comparison
from everplace.experiments.comparison_parts import PairResult, keep_pictures
from everplace.experiments.latent_report import audit_section, latent_section
from everplace.experiments.lead import comparison_lead, sequence_sentence
from everplace.experiments.manifest import DEFINITIONS
from everplace.experiments.precision_section import precision_section
from everplace.experiments.recipe_names import named_method
from everplace.experiments.retrieval_pictures import match_figure, matrix_figure, score_of, title_of
from everplace.files import json_text, write_json, write_text
from everplace.locking import locked
from everplace.plots.canvas import new_figure, save_figure
from everplace.plots.interactive_curves import precision_recall_figure
from everplace.plots.precision_recall import draw_precision_recall_panels
from everplace.report.html import Report, Section
from everplace.scoring.precision_table import good_enough_for
from everplace.scoring.retrieval import pair_of

__all__ = ["write_comparison"]


_FEW_PAIRS = 2
"""With more, a pair shows the pictures of its best method alone, fewer matches, at the page's own resolution."""

_MOST_COLUMNS = 8


def write_comparison(comparison: Comparison, out: Path, *, title: str, details: dict[str, str]) -> Report:
    """Writes metrics.json, table.md, pr_curves.png, report.html and pictures of each model's latent into a directory.

    Pictures of models that are no longer compared are removed.

    Returns:
        The report as written, so that a caller may add sections and write it again.

    Raises:
        ConfigError: Another process writes into the directory.
        StorageError: Writing failed.
    """
    route = comparison.route
    right, matching = right_words(comparison.study.truth), matching_words(comparison.study.matching)
    subtitle = f"{route.title}: {comparison.places} places, {right}, {matching}"
    names = _names(comparison)
    found = {names[label]: comparison.mean("recall@1", label) for label in comparison.methods}
    report = Report(title, subtitle=subtitle, lead=comparison_lead(found, len(comparison.results)), details=details)
    panels = {
        pair: {names[label]: one.curve for label, one in results.items()}
        for pair, results in comparison.results.items()
    }
    columns = max(2, min(_MOST_COLUMNS, len(route.traverses) - 1))  # a row holds one query condition
    figure = new_figure(max(10.0, 1.9 * columns))
    draw_precision_recall_panels(figure, panels, columns=columns)
    with locked(out):
        save_figure(figure, out / "pr_curves.png")
        _summary(report, comparison, figure)
        for pair, results in comparison.results.items():
            _pair_section(report, comparison, pair, results)
        if comparison.audits:
            section = report.section("Leakage audit")
            _say_remarks(section, comparison)
            audit_section(section, {names[label]: one for label, one in comparison.audits.items()})
        pictures: list[str] = []
        for label, describer in comparison.describers.items():
            model = describer.latent_model
            if model is not None and route.aligned:
                section = report.section(f"What the latent of {names[label]} holds")
                pictures += latent_section(section, model, route, out, names[label], prefix=f"{label}-")
        keep_pictures(out, pictures)
        _how(report, comparison)
        write_text(out / "table.md", _markdown(comparison))
        write_json(out / "metrics.json", comparison.metrics())
        report.write(out / "report.html")
    return report


def _summary(report: Report, comparison: Comparison, panels: Figure) -> None:
    section = report.section("Summary")
    header, rows = comparison.table()
    section.table(
        header, rows, caption="Means over all ordered pairs of conditions.", best=dict.fromkeys(SCORES, "highest")
    )
    _say_remarks(section, comparison)
    for method, reason in comparison.left_out.items():
        section.paragraph(f"{method} was left out: {reason}")
    for note in comparison.notes:
        section.paragraph(note)
    for footnote in comparison.footnotes:
        section.paragraph(footnote)
    section.figure(
        panels,
        alt=f"Precision-recall curves of {len(comparison.methods)} methods, a panel for each ordered pair.",
        caption="Precision-recall curves. Above each panel: query → database, the frames of the first condition looked "
        "for among those of the second. A dot marks the end of a curve, where every proposal counts.",
    )


def _say_remarks(section: Section, comparison: Comparison) -> None:
    for remark in comparison.remarks:
        section.paragraph(remark)


def _how(report: Report, comparison: Comparison) -> None:
    section = report.section("How it was measured")
    told = {"truth": f"What is right is known from {comparison.truth_source}.", **DEFINITIONS}
    section.table(["what", "definition"], [[name, text] for name, text in told.items()])
    section.folded("Manifest", json_text(comparison.manifest))


def _pair_section(
    report: Report, comparison: Comparison, names: tuple[str, str], results: dict[str, PairResult]
) -> None:
    query, database = names
    pair = pair_of(comparison.route, query, database)
    section = report.section(_capitalised(pair_words(query, database)))
    shown = _names(comparison)
    areas = {label: one.scores.auc_pr for label, one in results.items()}
    named = {shown[label]: area for label, area in areas.items()}
    section.chart(
        precision_recall_figure({shown[label]: one.curve for label, one in results.items()}, areas=named),
        alt="Precision-recall curves: " + ", ".join(f"{label} {area:.3f}" for label, area in named.items()) + ".",
        caption="Best match of each query; the legend gives the area under the curve.",
    )
    header, rows = comparison.table(names)
    section.table(header, rows, best=dict.fromkeys(SCORES, "highest"))
    alone = {shown[label]: one.frame_by_frame for label, one in results.items() if one.frame_by_frame is not None}
    together = {shown[label]: one.scores for label, one in results.items()}
    if said := sequence_sentence(comparison.study.matching, alone, together):
        section.paragraph(said)
    _say_remarks(section, comparison)
    many = len(comparison.results) > _FEW_PAIRS
    for label in _shown(comparison, areas)[-1 if many else 0 :]:
        result = comparison.retrieval(pair, label)
        title, score = title_of(result, shown[label]), score_of(result)
        precision_section(section, shown[label], results[label].precision_table, score)
        section.figure(
            matrix_figure(result, shown[label]),
            alt=f"Similarity matrix of {title}.",
            caption=matrix_caption(query, database, result.rule, score),
            dpi=96 if many else 192,
        )
        section.figure(
            match_figure(result, shown[label], count=4 if many else 8),
            alt=f"Matches of {title}.",
            caption=match_caption(result.rule, score),
            dpi=96 if many else 192,
            photos=True,
        )


def _names(comparison: Comparison) -> dict[str, str]:
    """By label, what pictures call each method."""
    return {label: named_method(label, one.settings()) for label, one in comparison.describers.items()}


def _capitalised(text: str) -> str:
    return text[0].upper() + text[1:]


def _shown(comparison: Comparison, areas: Mapping[str, float]) -> list[str]:
    """The methods whose matches are worth a look: the best model of the VAE family, and the best of all."""
    models = [label for label in areas if comparison.describers[label].latent_model is not None]
    return list(dict.fromkeys(max(group, key=lambda label: areas[label]) for group in (models, list(areas)) if group))


def _markdown(comparison: Comparison) -> str:
    right, matching = right_words(comparison.study.truth), matching_words(comparison.study.matching)
    lines = [f"{comparison.route.title}: {right}, {matching}", "", f"Truth: {comparison.truth_source}", ""]
    if len(comparison.results) > 2:
        lines += ["**Mean over all ordered pairs**", "", *_markdown_table(*comparison.table()), ""]
    for query, database in comparison.results:
        table = comparison.table((query, database))
        lines += [f"**{_capitalised(pair_words(query, database))}**", "", *_markdown_table(*table), ""]
        results = comparison.results[query, database]
        best = _shown(comparison, {label: one.scores.auc_pr for label, one in results.items()})[-1]
        lines += [f"{best}: {good_enough_for(results[best].precision_table)}", ""]
    lines += [f"{remark}  " for remark in comparison.remarks]
    lines += [f"{method} was left out: {reason}  " for method, reason in comparison.left_out.items()]
    lines += [f"{note}  " for note in comparison.notes]
    lines += [f"{footnote}  " for footnote in comparison.footnotes]
    if comparison.remarks or comparison.left_out or comparison.notes or comparison.footnotes:
        lines += [""]
    lines += [f"{name}: {DEFINITIONS[name]}  " for name in COSTS]
    return "\n".join(lines).rstrip() + "\n"


def _markdown_table(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> list[str]:
    head = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return head + ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]


def _cell(value: Cell) -> str:
    if value is None:
        return "\N{EN DASH}"
    # A bar would begin another cell.
    return f"{value:.3f}" if isinstance(value, float) else str(value).replace("|", "\\|")
