"""`everplace evaluate`: one method on one pair of conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from everplace.audit.leakage import Audit, audit
from everplace.describe.costs import ImageTime, time_describer
from everplace.describe.describer import Describer
from everplace.experiments.recipe_names import recipe_metrics
from everplace.experiments.trust import seen_places, truth_source
from everplace.progress import Progress, quiet
from everplace.route.pack import pack
from everplace.route.route import Route
from everplace.scoring.precision_table import AtPrecision, good_enough_for
from everplace.scoring.retrieval import MatchRule, Retrieval
from everplace.scoring.scores import Scores

__all__ = [
    "Evaluation",
    "audit_pair",
    "evaluate_retrieval",
    "precision_metrics",
]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One method on one pair.

    Attributes:
        result: Scores, curve and similarity.
        audit: The leakage audit; None unless the method is of the VAE family and the traverses are aligned.
        image_time: Description alone, see `everplace.describe.costs.time_describer`.
        trained_places: Tested places that the model was trained on or chosen by.
        source: The method as it was given, such as the path of a run.
    """

    result: Retrieval
    audit: Audit | None
    image_time: ImageTime
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
            **self._scores(),
            **(result.rule or MatchRule()).metrics(),
            "truth_from": truth_source(result.pair.route, result.rule),
            "aligned_by": result.pair.route.aligned_by,
            **result.matching.metrics(),
            "dimension": result.describer.dimension,
            "ms_per_image": round(self.image_time.ms, 4),
            "measured_beside_other_work": self.image_time.beside_other_work,
            "trained_places_tested": self.trained_places,
            **({"new_place": result.new_place} if result.new_place is not None else {}),
            **({"audit": self.audit.to_dict()} if self.audit is not None else {}),
        }

    def _scores(self) -> dict[str, Any]:
        """The scores; where nobody knows what is right they are None, and what can be said stands beside them."""
        result = self.result
        if result.scores is not None and result.precision_table is not None:
            alone = result.frame_by_frame
            return {
                **result.scores.to_dict(),
                **precision_metrics(result.precision_table),
                **({"frame_by_frame": alone.to_dict()} if alone is not None else {}),
            }
        best = result.similarity.max(axis=1)
        return {
            **dict.fromkeys([*(field.name for field in fields(Scores)), *PRECISION_METRICS]),
            "queries": len(result.query),
            "database": len(result.database),
            "unscored": result.why_unscored,
            "match_scores": {
                "kind": result.matching.score_kind(result.describer.metric),
                "lowest": float(best.min()),
                "median": float(np.median(best)),
                "highest": float(best.max()),
            },
        }


PRECISION_METRICS = ("precision_table", "good_enough_for")


def precision_metrics(table: Mapping[str, AtPrecision]) -> dict[str, Any]:
    """What metrics.json says of choosing a threshold, by `PRECISION_METRICS`."""
    rows = {name: row.to_dict() for name, row in table.items()}
    return dict(zip(PRECISION_METRICS, (rows, good_enough_for(table)), strict=True))


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
        image_time=time_describer(describer, result.query.paths),
        trained_places=seen_places(describer, result.pair.tested),
        source=source,
    )


def audit_pair(describer: Describer, route: Route, truth: MatchRule | None, progress: Progress = quiet) -> Audit | None:
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
        truth.tolerance if truth is not None and truth.tolerance is not None else 1,
        conditions=[traverse.condition for traverse in route.traverses],
    )
