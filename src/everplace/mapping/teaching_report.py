"""A page to look at what a map matched by itself: how much of a drive, how surely, and the pairs as pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from everplace.files import write_json
from everplace.mapping.self_teaching import RUN, SURE
from everplace.mapping.taught_drive import TaughtDrive
from everplace.plots.canvas import Image, new_axes, new_figure
from everplace.plots.match_gallery import Match, draw_matches
from everplace.plots.matched_frames import draw_matched_frames
from everplace.report.html import Report, Section
from everplace.report.table_cells import Value
from everplace.route.selection import spread

__all__ = ["PAIRS_JSON", "REPORT_HTML", "ShownDrive", "write_teaching_report"]

PAIRS_JSON, REPORT_HTML = "pairs.json", "report.html"
_SHOWN = 6
"""Pairs of each kind on the sheet."""


@dataclass(frozen=True, eq=False)
class ShownDrive:
    """A drive that was matched by its images, with the pictures of it.

    Attributes:
        drive: What it taught.
        frame: Gives the picture of the drive's frame at a position.
        place: Gives the picture of the map's place at a position.
    """

    drive: TaughtDrive
    frame: Callable[[int], Image]
    place: Callable[[int], Image]


def write_teaching_report(out: Path, map_name: str, shown: Sequence[ShownDrive], details: Mapping[str, str]) -> None:
    """Writes DIR/pairs.json, every frame with its match, and DIR/report.html.

    Args:
        out: The directory, which exists.
        map_name: What the map is called.
        shown: The drives.
        details: Where the report comes from.

    Raises:
        ImageError: A frame that is to be shown cannot be decoded.
        StorageError: Writing failed.
    """
    drives = [{**one.drive.summary(), "matches": list(one.drive.rows())} for one in shown]
    write_json(out / PAIRS_JSON, {"map": map_name, "log_odds": SURE, "run": RUN, "drives": drives})
    report = Report(
        f"What {map_name} matched by itself",
        subtitle=f"A pair teaches if its log-odds are above {SURE:g} and it is one of at least {RUN} in a row.",
        lead=" ".join(_sentence(one.drive) for one in shown),
        details=details,
    )
    for one in shown:
        _add_drive(report.section(f"Drive {one.drive.name}"), map_name, one)
    report.write(out / REPORT_HTML)


def _sentence(drive: TaughtDrive) -> str:
    pairs, of = len(drive.pairs.frames), drive.pairs.of
    told = f"Of the {of:,} frames of {drive.name}, {pairs:,} ({drive.pairs.share:.0%}) found their place surely"
    return f"{told}." if drive.right is None else f"{told}, {drive.right:.1%} of these rightly."


def _add_drive(section: Section, map_name: str, shown: ShownDrive) -> None:
    drive, matches = shown.drive, shown.drive.matches
    sure, correct, odds = drive.sure, drive.correct, matches.log_odds
    facts: dict[str, Value] = {
        "frames": drive.pairs.of,
        "sure pairs": len(drive.pairs.frames),
        "share": drive.pairs.share,
        "least log-odds of a pair": float(odds[sure].min()) if sure.any() else None,
        "mean probability of a pair": float(expit(odds[sure].astype(float)).mean()) if sure.any() else None,
    }
    if correct is not None and drive.true is not None:
        of_map = ~sure & (drive.true >= 0)
        facts["right, of the pairs"] = drive.right
        facts["right, of the refused"] = float(correct[of_map].mean()) if of_map.any() else None
    section.facts(facts)
    figure, axes = new_axes(6.4, 4.0)
    title = f"{drive.name} on {map_name}"
    draw_matched_frames(axes, matches.places, sure, drive=drive.name, map_drive=map_name, title=title)
    section.figure(
        figure,
        alt=f"The best place of every frame of {drive.name}, sure or refused.",
        caption="Each point is a frame with its best place. Wanted: a line. A cloud is a drive that was not here.",
    )
    note = "number: log-odds that the frame shows the place" + ("" if correct is None else "; right: within ±1 place")
    for what, caption, frames in _kinds(odds, sure, correct):
        if not len(frames):
            section.paragraph(f"There is nothing {what}.")
            continue
        gallery = new_figure(10)
        draw_matches(gallery, [_match(shown, frame) for frame in frames.tolist()], title=f"{title}: {what}", note=note)
        section.figure(gallery, alt=f"{what}: frames and the places proposed.", caption=caption, photos=True)


def _kinds(
    odds: NDArray[np.float32], sure: NDArray[np.bool_], correct: NDArray[np.bool_] | None
) -> list[tuple[str, str, NDArray[np.int64]]]:
    """What is shown, each kind with its caption and its frames in the order of travel."""
    taught, refused = np.flatnonzero(sure), np.flatnonzero(~sure)
    half = _SHOWN // 2
    least = taught[odds[taught].argsort(kind="stable")[:half]]
    nearly = refused[(-odds[refused]).argsort(kind="stable")[:half]]
    border = np.sort(np.concatenate([least, nearly]))
    kinds = [
        ("sure", "Pairs that taught, spread over the drive.", np.setdiff1d(taught, border)),
        (
            "borderline",
            f"The {half} least sure pairs that taught, and the {half} surest frames that did not: their log-odds are "
            f"too low, or they are not part of a run of {RUN}.",
            border,
        ),
        ("refused", "Frames that taught nothing, spread over the drive.", np.setdiff1d(refused, border)),
    ]
    if correct is not None:
        wrong = "Pairs that taught although they are not within one place of the truth, spread over the drive."
        kinds.append(("wrong", wrong, np.flatnonzero(sure & ~correct)))
    return [(what, caption, frames[spread(len(frames), _SHOWN)]) for what, caption, frames in kinds]


def _match(shown: ShownDrive, frame: int) -> Match:
    drive = shown.drive
    place, correct = int(drive.matches.places[frame]), drive.correct
    true = -1 if drive.true is None else int(drive.true[frame])
    return Match(
        query=shown.frame(frame),
        proposed=shown.place(place),
        true=shown.place(true) if true >= 0 else None,
        score=float(drive.matches.log_odds[frame]),
        right=None if correct is None else bool(correct[frame]),
        query_name=f"{drive.name}/{drive.stems[frame]}",
        proposed_name=drive.map_stems[place],
        true_name=drive.map_stems[true] if true >= 0 else "",
    )
