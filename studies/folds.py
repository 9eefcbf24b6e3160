"""Nordland64 whole, tested by models that never saw it: `python -m studies folds --data DATA --out OUT`.

The places that are left without dark and stationary ones are cut into five folds. For each, `best` is trained on the
longest stretch of the others, 20 places away, and tested on the fold, which is also the map: frame by frame, over the
last frames of the drive as recorded, and of the drive resampled to other speeds with stops. HOG stands beside it. A
stopped study goes on with the runs that are there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from everplace.describe.registry import open_describer
from everplace.errors import RouteError
from everplace.files import write_text
from everplace.model.checkpoint import load_checkpoint
from everplace.route.route import Route, open_route
from everplace.route.traverse import Traverse
from everplace.scoring.scores import evaluate
from everplace.sequences.sequence_search import search_sequences
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from studies.drives import AS_RECORDED, RESAMPLED, DrivePair, Recorded, choose_drives, similarities
from studies.paired import Found, found_on, paired_difference, together
from studies.protocols import PROTOCOLS

FOLDS = 5
GAP = 20
UNTRAINED = "HOG"


@dataclass(frozen=True)
class Fold:
    """Places start to end, and the places that its model is trained on."""

    start: int
    end: int
    trained: str

    @property
    def tested(self) -> str:
        return f"{self.start}:{self.end}"


@dataclass(frozen=True)
class FoldResult:
    """What a method finds on one fold: scores of single frames, and the filter on the drives."""

    recall: float
    auc_pr: float
    recorded: Found
    resampled: tuple[Found, ...]


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies folds", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="directory that holds nordland64")
    parser.add_argument("--out", type=Path, required=True, help="directory for runs, table.md and metrics.json")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="of the models")
    parser.add_argument("--epochs", type=int, default=16)
    parser.add_argument("--drives", type=int, default=20, help="resampled drives that are averaged")
    parser.add_argument("--length", type=int, default=10, help="frames of a sequence")
    given = parser.parse_args(arguments)
    route = open_route(given.data / "nordland64")
    places = len(choose_drives(route, ":").database)
    folds = cut(places)
    pairs = [choose_drives(route, fold.tested) for fold in folds]
    results: dict[str, list[FoldResult]] = {}
    for seed in given.seeds:
        runs = [
            _trained(route, fold, pair.database, seed, given.epochs, given.out)
            for fold, pair in zip(folds, pairs, strict=True)
        ]
        results[f"`best`, seed {seed}"] = _measured(list(map(str, runs)), pairs, given.length, given.drives)
    results[UNTRAINED] = _measured(["hog"] * FOLDS, pairs, given.length, given.drives)
    metrics = {name: _metrics(of, folds) for name, of in results.items()}
    table = _table(metrics, folds, given.length)
    write_text(given.out / "metrics.json", json.dumps(metrics, indent=1) + "\n")
    write_text(given.out / "table.md", table)
    print(table, end="")


def cut(places: int) -> list[Fold]:
    """Cuts the places into folds, each with the longest stretch of places that are `GAP` away.

    Raises:
        RouteError: So few places leave none to train on.
    """
    if places < FOLDS * GAP:
        raise RouteError(f"nordland64 has {places} places here, too few for {FOLDS} folds; at least {FOLDS * GAP}")
    edges = [places * index // FOLDS for index in range(FOLDS + 1)]
    folds = []
    for start, end in pairwise(edges):
        first, last = max((0, start - GAP), (end + GAP, places), key=lambda part: part[1] - part[0])
        folds.append(Fold(start, end, f"{first}:{last}"))
    return folds


def _trained(route: Route, fold: Fold, tested: Traverse, seed: int, epochs: int, out: Path) -> Path:
    protocol = PROTOCOLS["nordland64"]
    values = {**protocol.settings, **protocol.variants["cp-vae, best"], "conditions": protocol.conditions}
    values |= {"frames": fold.trained, "drop_dark": True, "drop_stationary": True, "seed": seed, "epochs": epochs}
    config = TrainConfig.build(**values)
    run = out / "runs" / f"for-{fold.start}-to-{fold.end}-seed-{seed}"
    train(route, config, run, resume=True, show=True)
    if not load_checkpoint(run).seen_stems.isdisjoint(tested.stems):
        raise RouteError(f"{run} was trained on places of its fold, {fold.tested}")
    return run


def _measured(methods: Sequence[str], pairs: Sequence[DrivePair], length: int, drives: int) -> list[FoldResult]:
    return [_on_fold(method, chosen, length, drives) for method, chosen in zip(methods, pairs, strict=True)]


def _on_fold(method: str, chosen: DrivePair, length: int, drives: int) -> FoldResult:
    describer = open_describer(method)
    recorded = Recorded(describer.describe(chosen.whole), chosen.place)
    database = describer.describe(chosen.database)
    found: list[Found] = []
    for drive in (AS_RECORDED, RESAMPLED):
        for S, truth, shown in similarities(recorded, database, chosen.truth, None, drive, drives):
            if not found:
                scores = evaluate(S, truth)
            found.append(found_on(search_sequences(S, length, "filter"), truth, shown))
    return FoldResult(scores.recall_at["1"], scores.auc_pr, found[0], tuple(found[1:]))


def _metrics(results: Sequence[FoldResult], folds: Sequence[Fold]) -> dict[str, Any]:
    starts = [fold.start for fold in folds]
    recorded = together([result.recorded for result in results], starts)
    drives = [together(parts, starts) for parts in zip(*(result.resampled for result in results), strict=True)]
    each = [
        {
            "one frame": [result.recall, result.auc_pr],
            "recorded": float(result.recorded.right.mean()),
            "resampled": float(np.mean([drive.right.mean() for drive in result.resampled])),
        }
        for result in results
    ]
    whole = {
        "one frame": float(np.average([result.recall for result in results], weights=[f.end - f.start for f in folds])),
        "recorded": float(recorded.right.mean()),
        "resampled": float(np.mean([drive.right.mean() for drive in drives])),
        **paired_difference(recorded, drives),
    }
    return {"folds": each, "all places": whole}


def _table(metrics: dict[str, Any], folds: Sequence[Fold], length: int) -> str:
    searched = f"filter, {length} frames"
    lines = [f"| places | trained on | method | one frame | {searched}, as recorded | resampled |", "|---" * 6 + "|"]
    for index, fold in enumerate(folds):
        for name, of in metrics.items():
            one = of["folds"][index]
            single = " / ".join(f"{value:.3f}" for value in one["one frame"])
            trained = "none" if name == UNTRAINED else fold.trained
            found = f"{one['recorded']:.4f} | {one['resampled']:.4f}"
            lines.append(f"| {fold.tested} | {trained} | {name} | {single} | {found} |")
    lines += ["", "All folds together:", ""]
    lines += ["| method | one frame | as recorded | resampled | difference | interval | drives no worse |"]
    lines += ["|---" * 7 + "|"]
    for name, of in metrics.items():
        one = of["all places"]
        cells = [name, f"{one['one frame']:.3f}", f"{one['recorded']:.4f}", f"{one['resampled']:.4f}"]
        cells += [f"{one['difference']:+.4f}", f"{one['low']:+.4f} to {one['high']:+.4f}", f"{one['no worse']:.0%}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
