"""What a comparison writes: metrics.json, table.md, pr_curves.png and report.html."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from everplace.describe.methods.vae import VAEDescriber
from everplace.experiments.comparison import SCORES, Comparison
from everplace.experiments.latent_report import audit_section, latent_section
from everplace.experiments.pictures import match_figure, matrix_figure
from everplace.experiments.retrieval import Pair, Retrieval
from everplace.files import write_text
from everplace.plots.canvas import new_figure, save_figure
from everplace.plots.curves import draw_precision_recall_panels
from everplace.plots.interactive import precision_recall_figure
from everplace.report.html import Report

__all__ = ["write_comparison"]


def write_comparison(comparison: Comparison, out: Path, *, title: str, details: dict[str, str]) -> Report:
    """Writes metrics.json, table.md, pr_curves.png and report.html into a directory.

    Returns:
        The report as written, so that a caller may add sections and write it again.

    Raises:
        StorageError: Writing failed.
    """
    route = comparison.route
    subtitle = f"{route.name}: {len(route.traverses[0])} places, {comparison.truth}, match {comparison.matching}"
    report = Report(title, subtitle=subtitle, details=details)
    _summary(report, comparison)
    for pair, results in comparison.results.items():
        _pair_section(report, comparison, pair, results)
    if comparison.audits:
        audit_section(report.section("Leakage audit"), comparison.audits)
    for label, describer in comparison.describers.items():
        if isinstance(describer, VAEDescriber) and route.aligned:
            latent_section(report.section(f"What the latent of {label} holds"), describer, route, out, f"{label}-")
    panels = {
        pair: {label: one.curve for label, one in results.items()} for pair, results in comparison.results.items()
    }
    figure = new_figure()
    draw_precision_recall_panels(figure, panels)
    save_figure(figure, out / "pr_curves.png")
    write_text(out / "table.md", _markdown(comparison))
    write_text(out / "metrics.json", json.dumps(comparison.metrics(), indent=2) + "\n")
    report.write(out / "report.html")
    return report


def _summary(report: Report, comparison: Comparison) -> None:
    section = report.section("Summary")
    rows: list[list[str | float | int | None]] = [
        [label, comparison.mean_auc_pr(label), _mean_recall(comparison, label)] for label in comparison.describers
    ]
    section.table(
        ["method", "auc_pr", "recall@1"],
        rows,
        caption="Means over all ordered pairs of conditions.",
        best={"auc_pr": "highest", "recall@1": "highest"},
    )
    for method, reason in comparison.left_out.items():
        section.paragraph(f"{method} was left out: {reason}")


def _pair_section(
    report: Report, comparison: Comparison, names: tuple[str, str], results: dict[str, Retrieval]
) -> None:
    query, database = names
    pair = Pair(comparison.route[query], comparison.route[database])
    section = report.section(f"{query} against {database}")
    areas = {label: one.scores.auc_pr for label, one in results.items()}
    section.chart(
        precision_recall_figure({label: one.curve for label, one in results.items()}, areas=areas),
        alt="Precision-recall curves: " + ", ".join(f"{label} {area:.3f}" for label, area in areas.items()) + ".",
        caption="Best match of each query; the legend gives the area under the curve.",
    )
    header, rows = comparison.table(names)
    section.table(header, rows, best=dict.fromkeys(SCORES, "highest"))
    for label in _shown(comparison, areas):
        section.figure(
            matrix_figure(pair, results[label], title=label),
            alt=f"Similarity matrix of {label}.",
            caption="Similarity matrix",
        )
        section.figure(
            match_figure(pair, results[label], title=label),
            alt=f"Matches of {label}.",
            caption="Right and wrong matches",
        )


def _shown(comparison: Comparison, areas: Mapping[str, float]) -> list[str]:
    """The methods whose matches are worth a look: the best model of the VAE family, and the best of all."""
    models = [label for label in areas if isinstance(comparison.describers[label], VAEDescriber)]
    return list(dict.fromkeys(max(group, key=lambda label: areas[label]) for group in (models, list(areas)) if group))


def _mean_recall(comparison: Comparison, label: str) -> float:
    return float(np.mean([results[label].scores.recall_at["1"] for results in comparison.results.values()]))


def _markdown(comparison: Comparison) -> str:
    lines = [f"{comparison.route.name}, {comparison.truth}, match {comparison.matching}", ""]
    for query, database in comparison.results:
        header, rows = comparison.table((query, database))
        lines += [f"**{query} against {database}**", "", "| " + " | ".join(header) + " |"]
        lines += ["|" + "---|" * len(header)]
        lines += ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]
        lines += [""]
    lines += [f"{method} was left out: {reason}" for method, reason in comparison.left_out.items()]
    return "\n".join(lines).rstrip() + "\n"


def _cell(value: str | float | None) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
