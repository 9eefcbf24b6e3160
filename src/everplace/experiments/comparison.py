"""Several methods on all ordered pairs of conditions, with one report."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np

from everplace.data.route import Route
from everplace.data.selection import Selection, parse_frames, select
from everplace.describe.descriptors import Descriptors
from everplace.describe.methods.vae import VAEDescriber
from everplace.describe.pipeline import time_describer
from everplace.describe.protocol import Describer
from everplace.describe.registry import method_names, open_describer
from everplace.errors import ConfigError, MethodError, RouteError
from everplace.evaluate.audit import Audit
from everplace.experiments.evaluation import audit_pair, audit_section, model_section
from everplace.experiments.pictures import match_figure, matrix_figure
from everplace.experiments.retrieval import Matching, Pair, Retrieval, Truth, retrieve, true_matches
from everplace.files import readable, write_text
from everplace.model.config import MODEL_KINDS
from everplace.plots.canvas import new_figure, save_figure
from everplace.plots.curves import draw_precision_recall_panels
from everplace.plots.interactive import precision_recall_figure
from everplace.progress import Progress, quiet
from everplace.report.html import Report
from everplace.training.config import DEFAULT_EPOCHS, TrainConfig
from everplace.training.fit import train

__all__ = ["Comparison", "compare_methods", "fit_and_open", "write_comparison"]

_SCORES = ("recall@1", "recall@5", "recall@10", "auc_pr", "AP", "R@100%P", "EP")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of several methods on one route.

    Attributes:
        route: The traverses, after selection.
        truth: When a match is right.
        matching: Options of the match.
        results: By (query, database) traverse name, then by the label of the method.
        audits: By label, for methods of the VAE family.
        describers: By label.
        left_out: Methods that could not run, with the reason.
    """

    route: Route
    truth: Truth
    matching: Matching
    results: dict[tuple[str, str], dict[str, Retrieval]]
    audits: dict[str, Audit]
    describers: dict[str, Describer]
    left_out: dict[str, str] = field(default_factory=dict)

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json."""
        return {
            "route": self.route.name,
            "places": len(self.route.traverses[0]),
            "tolerance": self.truth.tolerance,
            "radius": self.truth.radius,
            "standardise": self.matching.standardise,
            "sequence": self.matching.sequence,
            "pairs": [
                {
                    "query": query,
                    "database": database,
                    "methods": {
                        label: {
                            **one.scores.to_dict(),
                            "dimension": one.dimension,
                            "ms_per_image": round(one.ms_per_image, 4),
                        }
                        for label, one in results.items()
                    },
                }
                for (query, database), results in self.results.items()
            ],
            "mean_auc_pr": {label: self.mean_auc_pr(label) for label in self.describers},
            "audit": {label: one.to_dict() for label, one in self.audits.items()},
            "left_out": self.left_out,
        }

    def mean_auc_pr(self, label: str) -> float:
        """Mean of a method's auc_pr over the pairs."""
        return float(np.mean([results[label].scores.auc_pr for results in self.results.values()]))

    def table(self, pair: tuple[str, str]) -> tuple[list[str], list[list[str | float | int | None]]]:
        """Header and rows of one pair's scores."""
        header = ["method", *_SCORES, "dimension", "ms/image"]
        rows: list[list[str | float | int | None]] = []
        for label, one in self.results[pair].items():
            s = one.scores
            rows.append(
                [
                    label, s.recall_at["1"], s.recall_at["5"], s.recall_at["10"], s.auc_pr, s.average_precision,
                    s.recall_at_100_precision, s.extended_precision, one.dimension, one.ms_per_image,
                ]
            )  # fmt: skip
        return header, rows


def fit_and_open(
    route: Route,
    methods: Sequence[str],
    selection: Selection,
    fit_frames: str,
    out: Path,
    *,
    settings: Mapping[str, Any],
    progress: Progress = quiet,
) -> tuple[Route, dict[str, Describer], dict[str, str]]:
    """Opens every method; those named by a kind of model are trained first, into `out`/runs.

    Args:
        route: The chosen traverses.
        methods: Run directories, names of methods, or kinds of model to fit.
        selection: The places to test on.
        fit_frames: `A:B`, the places to fit on; they may not overlap the tested ones.
        out: The directory of the comparison.
        settings: Values of `TrainConfig` for the models that are fitted.
        progress: Told of decoding.

    Returns:
        The route restricted to the tested places, the methods by label, and those left out with the reason.

    Raises:
        ConfigError: A model is to be fitted without --fit-frames, or on tested places; or no method can run.
    """
    if not methods:
        raise ConfigError("--methods names no method; give run directories, sad, hog, ..., separated by commas")
    if fit_frames:
        parse_frames(fit_frames)
    tested = select(route, selection, progress)
    fitted = [method for method in methods if method in MODEL_KINDS]
    if fitted:
        _require_apart(select(route, replace(selection, frames=None), progress), selection.frames, fit_frames, fitted)
    describers: dict[str, Describer] = {}
    left_out: dict[str, str] = {}
    opened: dict[str, Describer] = {}
    for method in methods:  # before anything is fitted, which takes long
        if method in fitted:
            continue
        try:
            opened[method] = open_describer(method)
        except MethodError as error:
            if method.partition(":")[0] not in method_names():
                raise
            left_out[method] = str(error)
    for method in methods:
        if method in fitted:
            describers[method] = fit(route, {**settings, "model": method, "frames": fit_frames}, out, progress)
        elif method in opened:
            describers[_label(method, describers)] = opened[method]
    if not describers:
        raise ConfigError(f"--methods {','.join(methods)}: none of them can run: {'; '.join(left_out.values())}")
    return tested, describers, left_out


def fit(route: Route, settings: Mapping[str, Any], out: Path, progress: Progress = quiet) -> Describer:
    """Trains a model into `out`/runs, or goes on where an earlier call with the same settings stood.

    Args:
        route: The route to train on.
        settings: Values of `TrainConfig`.
        out: The directory of the study.
        progress: Told of decoding.

    Raises:
        ConfigError: A setting is wrong, or an earlier call used others.
    """
    run = out / "runs" / str(settings["model"])
    length = {} if {"minutes", "epochs"} & set(settings) else {"epochs": DEFAULT_EPOCHS}
    config = TrainConfig.build(**{**length, **settings})
    try:
        train(route, config, run, resume=True, progress=progress, show=True)
    except ConfigError as error:
        if not run.exists():
            raise
        raise ConfigError(
            f"{readable(out)} holds a study with other settings; name another --out, or remove it ({error})"
        ) from None
    return open_describer(str(run))


def _label(method: str, taken: Collection[str]) -> str:
    """A short name for the tables: of a run directory its last part, made unique."""
    name = Path(method).name if Path(method).is_dir() else method
    label, number = name, 2
    while label in taken:
        label, number = f"{name}-{number}", number + 1
    return label


def _require_apart(route: Route, frames: slice | None, fit_frames: str, fitted: Sequence[str]) -> None:
    if not fit_frames:
        raise ConfigError(f"{', '.join(fitted)} must be fitted: give --fit-frames A:B, places that --frames leaves out")
    total = min(len(traverse) for traverse in route.traverses)
    tested = range(total)[frames if frames is not None else slice(None)]
    both = set(tested).intersection(range(total)[parse_frames(fit_frames)])
    if both:
        raise ConfigError(
            f"--fit-frames {fit_frames} and --frames share {len(both)} places, from {min(both)} to {max(both)}; "
            "a method may not be fitted on the places it is tested on"
        )


def compare_methods(
    route: Route,
    describers: dict[str, Describer],
    *,
    truth: Truth,
    matching: Matching,
    left_out: dict[str, str] | None = None,
    progress: Progress = quiet,
) -> Comparison:
    """Runs every method on every ordered pair of traverses.

    Args:
        route: The traverses, after selection.
        describers: The methods by label.
        truth: When a match is right.
        matching: Options of the match.
        left_out: Methods that could not be opened, with the reason, for the report.
        progress: Told of the describing.

    Raises:
        RouteError: There is only one traverse.
    """
    if len(route.traverses) < 2:
        raise RouteError(f"a comparison needs two traverses, but {route.name} has one; add another or choose both")
    results: dict[tuple[str, str], dict[str, Retrieval]] = {}
    described: dict[str, dict[str, Descriptors]] = {label: {} for label in describers}
    timed = {label: time_describer(one, route.traverses[0].paths) for label, one in describers.items()}
    resolved = truth
    for query, database in permutations(route.traverses, 2):
        pair = Pair(query, database)
        matches, resolved = true_matches(route, pair, truth)
        results[query.name, database.name] = {
            label: retrieve(
                describer,
                pair,
                matches,
                matching,
                described=described[label],
                ms_per_image=timed[label],
                progress=progress,
            )
            for label, describer in describers.items()
        }
    audits = {label: audit_pair(describer, route, resolved, progress) for label, describer in describers.items()}
    known = {label: one for label, one in audits.items() if one is not None}
    return Comparison(route, resolved, matching, results, known, describers, left_out or {})


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
            model_section(report.section(f"What the latent of {label} holds"), describer, route, out, f"{label}-")
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
    section.table(header, rows, best=dict.fromkeys(_SCORES, "highest"))
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
