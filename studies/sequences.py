"""Sequence searches on a drive as recorded, and on it resampled: `python -m studies sequences --data DIR --out DIR`.

The parameters of the filter were chosen on places 0:1600 of nordland64; the tables are of 1620: unless --frames says
otherwise. Every other drive is the mean over several seeds.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from everplace.choices import SEQUENCE_METHODS, Standardisation
from everplace.describe.files.descriptors import Descriptors
from everplace.describe.registry import open_describer
from everplace.files import write_text
from everplace.match.matching import Matching, compare_descriptors
from everplace.route.route import open_route
from everplace.scoring.scores import evaluate
from everplace.sequences.evidence import likelihood_ratios, standardised
from everplace.sequences.frame_change import DriveEvidence, View, change_in_steps, new_frames
from everplace.sequences.route_filter import Answer, RouteFilter, filter_windows
from everplace.sequences.route_model import RouteModel
from everplace.sequences.route_path import best_path, smooth_route
from everplace.sequences.sequence_search import search_sequences
from studies.drives import DRIVES, TOLERANCE, Drive, Recorded, choose_drives, similarities
from studies.paired import Found, found_on, paired_difference

SURE = 0.9
KNOWN = "motion known"
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="python -m studies sequences", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="directory that holds nordland64")
    parser.add_argument("--out", type=Path, required=True, help="directory for table.md and metrics.json")
    parser.add_argument("--methods", nargs="+", default=["hog"], help="methods or run directories")
    parser.add_argument("--frames", default="1620:", help="places, after the filters")
    parser.add_argument("--lengths", type=int, nargs="+", default=[5, 10, 20], help="frames of a sequence")
    parser.add_argument("--seeds", type=int, default=5, help="drives that are averaged")
    given = parser.parse_args(arguments)
    route = open_route(given.data / "nordland64")
    chosen = choose_drives(route, given.frames)
    lines, metrics = [f"nordland64, winter against summer, --frames {given.frames}, ±{TOLERANCE} frames", ""], []
    for method in given.methods:
        describer = open_describer(method)
        recorded = Recorded(describer.describe(chosen.whole), chosen.place)
        database = describer.describe(chosen.database)
        for how in (None, "centre"):
            print(method, how or "plain", file=sys.stderr)
            changes = _changes(recorded, database, how)
            rows: list[dict[str, Any]] = []
            for drive in DRIVES:
                row, found = _measure(recorded, database, chosen.truth, how, drive, given.lengths, given.seeds)
                if not rows:
                    as_recorded = found
                elif drive.options is not None and not drive.hole:
                    row["against recorded"] = {
                        name: paired_difference(as_recorded[name][0], found[name]) for name in found
                    }
                rows.append(row)
            title = f"{method}, {'centred' if how else 'plain'}"
            lines += [*_tables(title, rows), *_change_table(title, changes)]
            measured = {"method": method, "standardise": how, "frames": given.frames}
            metrics.append({**measured, "drives": rows, "change": changes})
    table = "\n".join(lines).rstrip() + "\n"
    write_text(given.out / "metrics.json", json.dumps(metrics, indent=1) + "\n")
    write_text(given.out / "table.md", table)
    print(table, end="")


def _measure(
    recorded: Recorded,
    database: Descriptors,
    truth: NDArray[np.bool_],
    how: Standardisation | None,
    drive: Drive,
    lengths: list[int],
    seeds: int,
) -> tuple[dict[str, Any], dict[str, list[Found]]]:
    """The row of one drive, and what the filter found on it, by its name in the row."""
    scores: dict[str, list[tuple[float, ...]]] = {}
    answers: dict[str, list[dict[str, float | None]]] = {}
    by_frame: dict[str, list[Found]] = {}
    for S, matches, shown in similarities(recorded, database, truth, how, drive, seeds):
        scores.setdefault("one frame", []).append(_score(S, matches))
        for length in lengths:
            for search in SEQUENCE_METHODS[::-1]:
                found = search_sequences(S, length, search)
                scores.setdefault(f"{search}, {length} frames", []).append(_score(found, matches))
                if search == "filter":
                    one = found_on(found, matches, shown)
                    by_frame.setdefault(f"{search}, {length} frames", []).append(one)
                    once = f"{search}, {length} frames, every place once"
                    scores.setdefault(once, []).append((_by_place(one),))
                    counted = f"{search}, {length} frames, standing ones among them"
                    scores.setdefault(counted, []).append(_score(filter_last(S, length), matches))
            if not drive.hole:
                known = known_motion(S, shown, length)
                scores.setdefault(f"{KNOWN}, {length} frames", []).append(_score(known, matches))
        for name, given in _answers(S).items():
            answers.setdefault(name, []).append(_honesty(given, matches))
    row = {
        "drive": drive.what,
        "scores": {name: np.mean(values, axis=0).round(4).tolist() for name, values in scores.items()},
        "answers": {name: _means(values) for name, values in answers.items()},
    }
    return row, by_frame


def _changes(recorded: Recorded, database: Descriptors, how: Standardisation | None) -> dict[str, dict[str, float]]:
    """Quantiles of `change_in_steps` since the last frame in which the train moved, while it moves and stands."""
    scores = compare_descriptors(recorded.query, database, Matching(how))
    ratios = likelihood_ratios(standardised(scores), RouteModel())
    views = [View.of(row) for row in ratios]
    moving = recorded.moving
    before = moving[np.searchsorted(moving, np.arange(1, len(views))) - 1]
    changes = np.array([change_in_steps(views[last], views[frame]) for frame, last in enumerate(before, start=1)])
    moves = np.isin(np.arange(1, len(views)), moving)
    parts = {"moves": changes[moves], "stands": changes[~moves]}
    return {
        name: {f"{q:.0%}": float(np.quantile(of, q).round(4)) for q in QUANTILES}
        for name, of in parts.items()
        if len(of)
    }


def _change_table(title: str, changes: dict[str, dict[str, float]]) -> list[str]:
    lines = [f"**{title}**: change since the last frame in which the train moved, in steps of the map", ""]
    lines += ["| the train | " + " | ".join(f"{q:.0%}" for q in QUANTILES) + " |", "|---" * (len(QUANTILES) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(f"{v:.3f}" for v in of.values()) + " |" for name, of in changes.items()]
    return [*lines, ""]


def known_motion(S: NDArray[Any], shown: NDArray[np.int64], length: int) -> NDArray[np.float64]:
    """What the filter's evidence of the last L frames would give if the motion between them were known.

    No search that weighs each frame as the filter does can do more.

    Args:
        S: M×N scores; the second drive follows the first place by place.
        shown: M: the place that each frame was taken at.
        length: L, not counting frames of the place of the frame before.

    Returns:
        M×N: the sum of the filter's log-likelihood ratios over the window, every place of it once, each at the place
        from which the known motion leads to place j; beyond the ends of the map a frame says the least it can.
    """
    evidence = np.log(_said(S))
    out = np.zeros(S.shape)
    places = np.arange(S.shape[1])
    moves = np.flatnonzero(np.diff(shown, prepend=-1))
    for row in range(len(S)):
        window = moves[moves <= row][-length:]
        for frame in window[np.unique(shown[window], return_index=True)[1]]:
            origin = places - (shown[row] - shown[frame])
            inside = (origin >= 0) & (origin < len(places))
            out[row] += np.where(inside, evidence[frame, origin.clip(0, len(places) - 1)], evidence[frame].min())
    return out


def _said(S: NDArray[Any]) -> NDArray[np.float64]:
    """M×N: what each frame, or the one that it repeats, says of the places after those before it."""
    drive = DriveEvidence(S, RouteModel())
    return drive.after_others(0, len(drive.new)).repeat(drive.shown, axis=0)


def filter_last(S: NDArray[Any], length: int) -> NDArray[np.float32]:
    """What the filter says of frames i-L+1 to i alone, frames in which the robot stands counted among the L.

    Args:
        S: M×N scores.
        length: L.

    Returns:
        M×N log-odds.
    """
    out = filter_windows(S, length)
    new = new_frames(S, RouteModel())
    for row in range(len(S)):
        first = max(0, row - length + 1)
        if new[new <= row][-length:][0] < first:  # else the last L views are these frames
            out[row] = filter_windows(S[first : row + 1], length)[-1]
    return out


def _by_place(found: Found) -> float:
    """Recall@1 if all frames of a place together count as one, however long the robot was there."""
    frames, right = np.bincount(found.place), np.bincount(found.place, found.right)
    return float((right[frames > 0] / frames[frames > 0]).mean())


def _score(S: NDArray[Any], truth: NDArray[np.bool_]) -> tuple[float, float]:
    scores = evaluate(S, truth)
    return scores.recall_at["1"], scores.auc_pr


def _answers(S: NDArray[np.float32]) -> dict[str, list[Answer]]:
    """The answers from all frames so far, and looking back on the whole drive."""
    online = RouteFilter(S.shape[1], reach=TOLERANCE)
    path = best_path(S)
    return {
        "all frames so far": [online.update(row) for row in S],
        "the whole drive, smoothed": smooth_route(S, reach=TOLERANCE),
        "the whole drive, best path": [Answer(max(int(p), 0), float(p >= 0), float(p >= 0)) for p in path],
    }


def _means(values: list[dict[str, float | None]]) -> dict[str, float | None]:
    """Means over the drives that a measure has a meaning for."""
    known = {key: [value for one in values if (value := one[key]) is not None] for key in values[0]}
    return {key: float(np.mean(ones).round(4)) if ones else None for key, ones in known.items()}


def _honesty(answers: list[Answer], truth: NDArray[np.bool_]) -> dict[str, float | None]:
    """Whether answers are right and say so when they are not."""
    right = np.array([truth[row, one.place] for row, one in enumerate(answers)])
    mapped = truth.any(axis=1)
    lost = np.array([one.lost for one in answers])
    sure = np.array([one.probability for one in answers]) >= SURE
    return {
        "recall@1": float(right[mapped].mean()),
        "sure": float(sure.mean()),
        "right when sure": float(right[sure].mean()) if sure.any() else None,
        "lost on the map": float(lost[mapped].mean()),
        "lost off the map": float(lost[~mapped].mean()) if not mapped.all() else None,
    }


def _tables(title: str, rows: list[dict[str, Any]]) -> list[str]:
    lines = [f"**{title}**: recall@1 / auc_pr", "", "| search | " + " | ".join(row["drive"] for row in rows) + " |"]
    lines += ["|---" * (len(rows) + 1) + "|"]
    for name in rows[0]["scores"]:
        measured = [row["scores"].get(name) for row in rows]
        cells = ["" if of is None else " / ".join(f"{value:.3f}" for value in of) for of in measured]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    lines += ["", f"**{title}**: the filter's recall@1 less that as recorded, and its 95 % interval", ""]
    lines += ["| drive | search | difference | interval | drives no worse |", "|---|---|---|---|---|"]
    for row in rows:
        for name, of in row.get("against recorded", {}).items():
            interval = f"{of['low']:+.3f} to {of['high']:+.3f}"
            lines.append(f"| {row['drive']} | {name} | {of['difference']:+.4f} | {interval} | {of['no worse']:.0%} |")
    lines += ["", f"**{title}**: answers of the filter; sure: probability of at least {SURE}", ""]
    header = list(rows[0]["answers"]["all frames so far"])
    lines += ["| drive | from | " + " | ".join(header) + " |", "|---" * (len(header) + 2) + "|"]
    for row in rows:
        for name, values in row["answers"].items():
            cells = ["" if values[key] is None else f"{values[key]:.3f}" for key in header]
            lines.append(f"| {row['drive']} | {name} | " + " | ".join(cells) + " |")
    return [*lines, ""]
