"""Several methods on all ordered pairs of conditions."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from everplace.audit.leakage import Audit
from everplace.describe.costs import peak_memory, time_describer
from everplace.describe.describer import Describer
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import ConfigError, MethodError
from everplace.experiments.comparison_methods import Methods
from everplace.experiments.comparison_parts import PARTS, MethodResult, PairResult, Part
from everplace.experiments.evaluation import audit_pair, precision_metrics
from everplace.experiments.manifest import MANIFEST, Study, require_same_study
from everplace.experiments.recipe_names import named_recipe, recipe_metrics
from everplace.experiments.trust import circular_sentence, seen_places, seen_sentence, truth_source
from everplace.files import remove_leftovers, write_json
from everplace.locking import locked
from everplace.match.matching import Matching
from everplace.match.standardise import standardisable
from everplace.progress import Progress, quiet, shown
from everplace.route.route import Route
from everplace.scoring.retrieval import Pair, Retrieval, pair_of, retrieve_pair

__all__ = ["COSTS", "SCORES", "Cell", "Comparison", "compare_methods"]

SCORES = ("recall@1", "recall@5", "recall@10", "auc_pr", "AP", "R@100%P", "EP")
"""Columns of the tables, in the order of `Comparison.table`."""

COSTS = ("dimension", "bytes", "ms/image", "peak MB")
"""The further columns."""

Cell: TypeAlias = str | float | int | None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of several methods on one route.

    Attributes:
        study: What the methods share: route, truth, match.
        methods: Results by label.
        describers: By label.
        parts: By label, where the descriptors lie.
        left_out: Methods that could not run, with the reason.
        manifest: The content of manifest.json.
    """

    study: Study
    methods: dict[str, MethodResult]
    describers: dict[str, Describer]
    parts: dict[str, Part]
    left_out: dict[str, str] = field(default_factory=dict)
    manifest: dict[str, Any] = field(default_factory=dict)

    @property
    def route(self) -> Route:
        """The traverses, after selection."""
        return self.study.route

    @property
    def truth_source(self) -> str:
        """Where it is known from which frames show the same place: a part of a sentence."""
        return str(truth_source(self.route, self.study.truth))

    @property
    def places(self) -> int:
        """Frames of the shortest traverse: where stems tell the places, those that all traverses have."""
        return min(map(len, self.route.traverses))

    @property
    def results(self) -> dict[tuple[str, str], dict[str, PairResult]]:
        """By (query, database) traverse name, then by the label of the method."""
        names = [traverse.name for traverse in self.route.traverses]
        return {
            pair: {label: one.pairs[pair] for label, one in self.methods.items()} for pair in permutations(names, 2)
        }

    @property
    def remarks(self) -> list[str]:
        """What must stand at every table: remedies of each run, tested places it had seen, a truth that it made."""
        named = {label: named_recipe(one.settings()) for label, one in self.describers.items()}
        told = [f"{label}: {recipe}" for label, recipe in named.items() if recipe is not None]
        seen = [
            seen_sentence(label, self.describers[label], count) for label, count in self.trained_places.items() if count
        ]
        circular = [
            circular_sentence(label, one, self.route, self.study.truth) for label, one in self.describers.items()
        ]
        return told + seen + [sentence for sentence in circular if sentence]

    @property
    def trained_places(self) -> dict[str, int]:
        """By label, how many of the tested places the method was trained on or chosen by."""
        return {label: seen_places(one, self.route) for label, one in self.describers.items()}

    @property
    def notes(self) -> list[str]:
        """What else a reader must know, one sentence each."""
        busy = [label for label, one in self.methods.items() if one.beside_other_work]
        beside = f"ms/image of {', '.join(busy)} was measured beside other work, so it may be too high."
        return [one.unmeasured for one in self.methods.values() if one.unmeasured] + ([beside] if busy else [])

    @property
    def footnotes(self) -> list[str]:
        """What needs no warning, but would puzzle a reader of the tables."""
        if self.study.matching.sequence > 1:  # whose scores depend on what was driven before
            return []
        same = [
            label
            for label, one in self.methods.items()
            if self.describers[label].metric != "place-posterior" and _same_in_both_directions(one)
        ]
        if not same:
            return []
        return [
            f"AP of {', '.join(same)} is the same in both directions of a pair: it looks at all pairs of frames, "
            "whichever side asks, and a pair scores the same both ways."
        ]

    @property
    def audits(self) -> dict[str, Audit]:
        """By label, for methods of the VAE family."""
        return {label: one.audit for label, one in self.methods.items() if one.audit is not None}

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json."""
        return {
            "route": self.route.name,
            "protocol": self.route.protocol,
            "places": self.places,
            **self.study.truth.metrics(),
            "truth_from": self.truth_source,
            "aligned_by": self.route.aligned_by,
            **self.study.matching.metrics(),
            "pairs": [
                {
                    "query": query,
                    "database": database,
                    "methods": {
                        label: {
                            **one.scores.to_dict(),
                            **precision_metrics(one.precision_table),
                            **self.methods[label].costs(),
                            "measured_beside_other_work": self.methods[label].beside_other_work,
                            **({"frame_by_frame": one.frame_by_frame.to_dict()} if one.frame_by_frame else {}),
                            **({"new_place": one.new_place} if one.new_place is not None else {}),
                        }
                        for label, one in results.items()
                    },
                }
                for (query, database), results in self.results.items()
            ],
            "methods": {
                label: {
                    **recipe_metrics(self.describers[label].settings()),
                    "trained_places_tested": count,
                }
                for label, count in self.trained_places.items()
            },
            "mean_auc_pr": {label: self.mean("auc_pr", label) for label in self.methods},
            "audit": {label: one.to_dict() for label, one in self.audits.items()},
            "left_out": self.left_out,
        }

    def mean(self, score: str, label: str) -> float:
        """Mean of one of a method's `SCORES` over the pairs."""
        return float(np.mean([one.scores.columns()[score] for one in self.methods[label].pairs.values()]))

    def table(self, pair: tuple[str, str] | None = None) -> tuple[list[str], list[list[Cell]]]:
        """Header and rows of one pair's scores, or of their means over all pairs."""
        rows: list[list[Cell]] = []
        for label, method in self.methods.items():
            of_pair = {} if pair is None else method.pairs[pair].scores.columns()
            scores = [self.mean(name, label) if pair is None else of_pair[name] for name in SCORES]
            *costs, peak = method.costs().values()
            rows.append([label, *scores, *costs, None if peak is None else round(peak)])
        return ["method", *SCORES, *COSTS], rows

    def retrieval(self, pair: Pair, label: str) -> Retrieval:
        """One method's retrieval with its similarity matrix, which is not kept, from the descriptors that are."""
        described = {
            traverse.name: self.parts[label].described(self.describers[label], number, traverse)
            for number, traverse in enumerate(self.route.traverses)
            if traverse.name in (pair.query.name, pair.database.name)
        }
        study = self.study
        return retrieve_pair(pair, self.describers[label], study.truth, study.matching, described=described)


def compare_methods(
    study: Study, methods: Methods, out: Path, *, command: str = "", progress: Progress = quiet
) -> Comparison:
    """Runs every method on every ordered pair of traverses.

    What is done is kept in `out`/parts: an interrupted comparison goes on where it stood, and a finished one is read.

    Args:
        study: What the methods share.
        methods: The opened methods; those without a source get no peak memory.
        out: The directory of the comparison; gets manifest.json as soon as one method is done.
        command: How it was called, for the manifest.
        progress: Told of describing, measuring, scoring and auditing.

    Raises:
        ConfigError: The options of the match apply to none of the methods, or `out` holds another study or is in use.
        ImageError: A frame cannot be decoded.
        StorageError: `out` cannot be written to.
    """
    require_same_study(out, study)
    describers, unsuited = _suited(methods.describers, study.matching)
    left_out = {**methods.left_out, **unsuited}
    manifest = {
        **study.document,
        "methods": {label: _told(one) for label, one in describers.items()},
        "left_out": left_out,
        "fit": methods.fit,
        "command": command,
    }
    parts = {label: Part(out, label, study.key(_told(one))) for label, one in describers.items()}
    results: dict[str, MethodResult] = {}
    with locked(out):
        remove_leftovers(out, out / PARTS, *(out / PARTS).glob("*"))
        for label, describer in describers.items():
            result = parts[label].load()
            if result is None:
                result = _run(study, describer, methods.sources.get(label), parts[label], progress)
                parts[label].save(result)
            if not results:
                # Not before anything is done: a manifest refuses other images, such as one that had to be repaired.
                write_json(out / MANIFEST, manifest)
            results[label] = result
    return Comparison(study, results, describers, parts, left_out, manifest)


def _run(study: Study, describer: Describer, source: str | None, part: Part, progress: Progress) -> MethodResult:
    """One method on all pairs; only its own descriptors, and one similarity matrix, are in memory."""
    route = study.route
    image_time = shown(
        progress, f"timing {describer.method}", lambda: time_describer(describer, route.traverses[0].paths)
    )
    peak, unmeasured = shown(progress, f"memory of {describer.method}", lambda: _peak_memory(source, route))
    described: dict[str, Descriptors] = {
        traverse.name: part.described(describer, number, traverse, progress)
        for number, traverse in enumerate(route.traverses)
    }
    pairs: dict[tuple[str, str], PairResult] = {}
    ordered = list(permutations(route.traverses, 2))
    for query, database in progress(ordered, f"scoring {describer.method}", len(ordered)):
        pair = pair_of(route, query.name, database.name)
        one = retrieve_pair(pair, describer, study.truth, study.matching, described=described)
        assert one.scores is not None  # a study has a truth
        assert one.curve is not None
        assert one.precision_table is not None
        pairs[query.name, database.name] = PairResult(
            one.scores, one.curve, one.precision_table, one.frame_by_frame, one.new_place
        )
    audited = shown(progress, f"auditing {describer.method}", lambda: audit_pair(describer, route, study.truth, quiet))
    return MethodResult(
        pairs, describer.dimension, image_time.ms, image_time.beside_other_work, peak, unmeasured, audited
    )


def _same_in_both_directions(result: MethodResult) -> bool:
    """Whether the average precision does not depend on which traverse asks."""
    precision = {pair: one.scores.average_precision for pair, one in result.pairs.items()}
    return all(np.isclose(precision[pair], precision[pair[::-1]], rtol=1e-6) for pair in precision)


def _peak_memory(source: str | None, route: Route) -> tuple[float | None, str]:
    """The peak memory of a method, or why it is not known."""
    if source is None:
        return None, ""
    try:
        return peak_memory(source, route.traverses[0].paths), ""
    except MethodError as error:
        return None, str(error)


def _told(describer: Describer) -> dict[str, str | int | float | bool]:
    """What decides a method's numbers."""
    return {"method": describer.method, "metric": describer.metric, **describer.settings()}


def _suited(describers: dict[str, Describer], matching: Matching) -> tuple[dict[str, Describer], dict[str, str]]:
    """The methods to which the options of the match apply, and those left out, with the reason."""
    unsuited = {
        label: f"`standardise` {matching.standardise} does not apply to the words of {describer.method}"
        for label, describer in describers.items()
        if matching.standardise is not None and not standardisable(describer.metric)
    }
    if len(unsuited) == len(describers):
        raise ConfigError(f"{'; '.join(unsuited.values())}: leave it out, or compare other methods")
    return {label: one for label, one in describers.items() if label not in unsuited}, unsuited
