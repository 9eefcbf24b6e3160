"""Several methods on all ordered pairs of conditions."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np

from everplace.data.route import Route
from everplace.describe.descriptors import Descriptors
from everplace.describe.pipeline import time_describer
from everplace.describe.protocol import Describer
from everplace.errors import ConfigError, RouteError
from everplace.evaluate.audit import Audit
from everplace.experiments.evaluation import audit_pair
from everplace.experiments.retrieval import Matching, Pair, Retrieval, Truth, retrieve, true_matches
from everplace.match.standardise import standardisable
from everplace.progress import Progress, quiet

__all__ = ["SCORES", "Comparison", "compare_methods"]

SCORES = ("recall@1", "recall@5", "recall@10", "auc_pr", "AP", "R@100%P", "EP")
"""Columns of the tables, in the order of `Comparison.table`."""


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
            "truth": self.truth.pairs,
            **self.matching.metrics(),
            "pairs": [
                {
                    "query": query,
                    "database": database,
                    "methods": {
                        label: {
                            **one.scores.to_dict(),
                            "dimension": one.dimension,
                            "ms_per_image": round(one.ms_per_image, 4),
                            **({"new_place": one.new_place} if one.new_place is not None else {}),
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
        header = ["method", *SCORES, "dimension", "ms/image"]
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
        ConfigError: The options of the match apply to none of the methods.
    """
    if len(route.traverses) < 2:
        raise RouteError(f"a comparison needs two traverses, but {route.name} has one; add another or choose both")
    describers, unsuited = _suited(describers, matching)
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
    return Comparison(route, resolved, matching, results, known, describers, {**(left_out or {}), **unsuited})


def _suited(describers: dict[str, Describer], matching: Matching) -> tuple[dict[str, Describer], dict[str, str]]:
    """The methods to which the options of the match apply, and those left out, with the reason."""
    unsuited = {
        label: f"--standardise {matching.standardise} does not apply to the words of {describer.method}"
        for label, describer in describers.items()
        if matching.standardise is not None and not standardisable(describer.metric)
    }
    if len(unsuited) == len(describers):
        raise ConfigError(f"{'; '.join(unsuited.values())}: leave it out, or compare other methods")
    return {label: one for label, one in describers.items() if label not in unsuited}, unsuited
