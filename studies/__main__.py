"""Trains every model of a study with several seeds, evaluates it, and writes a table with means and spreads.

Every row is a file of its own, so a stopped study goes on, and several processes may share the work.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import sys
from pathlib import Path
from typing import Any

from everplace.errors import EverplaceError
from everplace.experiments.evaluation import evaluate_retrieval
from everplace.files import write_text
from everplace.route.route import Route, open_route
from everplace.route.selection import Selection, parse_frames
from everplace.scoring.retrieval import retrieve
from everplace.training.config import TrainConfig
from everplace.training.fit import train
from studies import (
    ablation,
    adaptation,
    calibration,
    comparisons,
    first_map,
    folds,
    living_map,
    map_kills,
    prior,
    quantised,
    sequences,
    served_page,
    teaching,
)
from studies.protocols import PROTOCOLS, Protocol
from studies.tables import SCORES, spread


def main() -> None:
    try:
        study()
    except EverplaceError as error:
        sys.exit(str(error))


def study() -> None:
    others = {
        "calibration": calibration.main,
        "sequences": sequences.main,
        "comparisons": comparisons.main,
        "folds": folds.main,
        "prior": prior.main,
        "ablation": ablation.main,
        "adaptation": adaptation.main,
        "quantised": quantised.main,
        "living_map": living_map.main,
        "first_map": first_map.main,
        "served_page": served_page.main,
        "map_kills": map_kills.main,
        "teaching": teaching.main,
    }
    if sys.argv[1:] and sys.argv[1] in others:
        others[sys.argv[1]](sys.argv[2:])
        return
    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    parser.add_argument(
        "study",
        choices=[*PROTOCOLS, *others],
        help=f"{', '.join(others)} come first and have options of their own: python -m studies STUDY --help",
    )
    parser.add_argument("--data", type=Path, required=True, help="directory that holds the study's route")
    parser.add_argument("--out", type=Path, required=True, help="directory for runs, ledger and table.md")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--variants", nargs="+", help="rows of the table to train (default: all)")
    parser.add_argument("--ledger", type=Path, help="directory of the ledger (default: OUT/ledger)")
    given = parser.parse_args()
    if given.study in others:
        parser.error(f"{given.study} must be the first argument")
    protocol = PROTOCOLS[given.study]
    unknown = set(given.variants or ()) - set(protocol.variants)
    if unknown:
        parser.error(f"--variants: {given.study} has no {min(unknown)!r}; it has: {', '.join(protocol.variants)}")
    ledger_directory = given.ledger or given.out / "ledger"
    route = open_route(given.data / protocol.route)
    for key, config, make in _rows(route, protocol, given):
        entry = ledger_directory / f"{key}.json"
        if entry.is_file():
            _require_same(entry, config)
        else:
            print(key, file=sys.stderr)
            write_text(entry, json.dumps(make(), indent=1) + "\n")
    files = sorted(ledger_directory.glob("*.json"))
    ledger = {file.stem: json.loads(file.read_text("utf-8")) for file in files}
    table = _table(protocol, ledger)
    write_text(given.out / "table.md", table)
    print(table, end="")


def _rows(route: Route, protocol: Protocol, given: argparse.Namespace) -> list[tuple[str, TrainConfig | None, Any]]:
    """The ledger's keys with what computes each, seeds outermost so that a stopped study has whole columns."""
    rows: list[tuple[str, TrainConfig | None, Any]] = [
        (name, None, lambda name=name: {"pairs": _evaluate(route, protocol, name)}) for name in protocol.baselines
    ]
    for seed in given.seeds:
        for variant in given.variants or protocol.variants:
            key = f"{variant}, seed {seed}"
            run = given.out / "runs" / key.replace(", ", "-").replace(" ", "-")
            config = _config(protocol, variant, seed)
            rows.append((key, config, lambda c=config, r=run: _fit_and_evaluate(route, protocol, c, r)))
    return rows


def _require_same(entry: Path, config: TrainConfig | None) -> None:
    """A row that was made with other settings does not belong into the same table."""
    made_with = json.loads(entry.read_text("utf-8")).get("config")
    if made_with is None or config is None:
        return
    # An option that did not exist then stands as it does by default; remedies that are gone were off in these rows.
    before = TrainConfig.model_validate({name: value for name, value in made_with.items() if name != "remedies"})
    changed = sorted(name for name in TrainConfig.model_fields if getattr(before, name) != getattr(config, name))
    if changed:
        sys.exit(f"{entry} was made with another {', '.join(changed)}; remove it, or name another --out")


def _config(protocol: Protocol, variant: str, seed: int) -> TrainConfig:
    return TrainConfig.build(
        **{
            **protocol.settings,
            **protocol.variants[variant],
            "conditions": protocol.conditions,
            "frames": protocol.train_frames,
            "drop_dark": protocol.filtered,
            "drop_stationary": protocol.filtered,
            "seed": seed,
        }
    )


def _fit_and_evaluate(route: Route, protocol: Protocol, config: TrainConfig, run: Path) -> dict[str, Any]:
    summary = train(route, config, run, resume=True, show=True)
    return {
        "config": config.model_dump(mode="json"),
        "seconds": round(summary.seconds, 1),
        "epoch": summary.best_epoch,
        "held_out": summary.best_value,
        "pairs": _evaluate(route, protocol, str(run)),
    }


def _evaluate(route: Route, protocol: Protocol, method: str) -> list[dict[str, Any]]:
    selection = Selection(parse_frames(protocol.test_frames), protocol.filtered, protocol.filtered)
    found = (
        retrieve(route, query, database, method, tolerance=protocol.tolerance, selection=selection)
        for query, database in protocol.pairs
    )
    return [evaluate_retrieval(result, method).metrics() for result in found]


def _table(protocol: Protocol, ledger: dict[str, Any]) -> str:
    lines = []
    for index, (query, database) in enumerate(protocol.pairs):
        lines += [f"**Query {query}, database {database}**", ""]
        lines += ["| method | numbers | " + " | ".join(SCORES) + " | training |", "|---" * (len(SCORES) + 3) + "|"]
        for name in _names(protocol, ledger):
            entries = _entries(ledger, name)
            if entries:
                lines.append(_line(name, entries, index))
        lines.append("")
    lines += _audit_lines(protocol, ledger)
    return "\n".join(lines).rstrip() + "\n"


def _names(protocol: Protocol, ledger: dict[str, Any]) -> list[str]:
    """The rows of a table: those that can be made, those of the ledger that cannot be made any more, baselines."""
    found = dict.fromkeys(re.sub(r", seed \d+$", "", key) for key in ledger)
    made = (*protocol.variants, *protocol.baselines)
    return [*protocol.variants, *(name for name in found if name not in made), *protocol.baselines]


def _entries(ledger: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """The entries of a method, one a seed."""
    return [entry for key, entry in ledger.items() if re.fullmatch(re.escape(name) + r"(, seed \d+)?", key)]


def _line(name: str, entries: list[dict[str, Any]], pair: int) -> str:
    measured = [entry["pairs"][pair] for entry in entries]
    values = [[read(one) for one in measured] for read in SCORES.values()]
    seconds = [entry["seconds"] for entry in entries if "seconds" in entry]
    training = f"{statistics.mean(seconds) / 60:.1f} min" if seconds else "none"
    cells = [name, str(measured[0]["dimension"]), *map(spread, values), training]
    return "| " + " | ".join(cells) + " |"


def _audit_lines(protocol: Protocol, ledger: dict[str, Any]) -> list[str]:
    lines = [
        "**Leakage audit** on the tested places",
        "",
        "| model | condition from z_p | from z_c | recall@1 by z_p | by z_c | by z | swap error | frame unchanged | "
        "mean image | active z_p / z_c |",
        "|---" * 10 + "|",
    ]
    for name in _names(protocol, ledger):
        audits = [entry["pairs"][0]["audit"] for entry in _entries(ledger, name) if "audit" in entry["pairs"][0]]
        if not audits:
            continue
        cells = [
            spread([max(a["condition_from_z_p"]["linear"], a["condition_from_z_p"]["mlp"]) for a in audits]),
            spread([max(a["condition_from_z_c"]["linear"], a["condition_from_z_c"]["mlp"]) for a in audits]),
            *(spread([a["recall_at_1"][block] for a in audits]) for block in ("z_p", "z_c", "z")),
            *(spread([a["swap"][k] for a in audits], 4) for k in ("mean_z_c", "unchanged", "mean_image")),
            " / ".join(f"{statistics.mean(a['active_dimensions'][b] for a in audits):.0f}" for b in ("z_p", "z_c")),
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return lines


if __name__ == "__main__":
    main()
