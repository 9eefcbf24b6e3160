"""Answers of a localizer as the files that SLAM and reconstruction read."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

from everplace.mapping.map_answer import MapAnswer

__all__ = ["COLUMNS", "LocatedFrame", "csv_text", "g2o_text", "hloc_pairs_text", "tum_text"]

COLUMNS = ("frame", "time", "place", "drive", "database_frame", "score", "probability", "off_map")


@dataclass(frozen=True, slots=True)
class LocatedFrame:
    """A frame of a drive and where it was taken.

    Attributes:
        frame: Its name: a file's stem, or a number in a video.
        answer: Where.
    """

    frame: str
    answer: MapAnswer


def csv_text(located: Sequence[LocatedFrame]) -> str:
    """One row a frame, with the columns `COLUMNS`: also loop closures for any SLAM."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for one in located:
        answer = one.answer
        time = "" if answer.time is None else f"{answer.time:.6f}"
        numbers = [f"{number:.6g}" for number in (answer.score, answer.probability, answer.off_map)]
        writer.writerow([one.frame, time, answer.place, answer.drive, answer.database_frame, *numbers])
    return text.getvalue()


def tum_text(located: Sequence[LocatedFrame]) -> str:
    """A trajectory in TUM's format: `time x y z qx qy qz qw`, of the frames whose place has a pose.

    Where a frame has no time, its number in the drive stands for it.
    """
    lines = []
    for number, one in enumerate(located):
        pose = one.answer.pose
        if pose is not None:
            time = number if one.answer.time is None else one.answer.time
            half = pose.heading / 2
            lines.append(f"{time:.6f} {pose.x:.6f} {pose.y:.6f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}\n")
    return "".join(lines)


def g2o_text(located: Sequence[LocatedFrame]) -> str:
    """Loop closures in g2o's format: a fixed vertex for each place of the map, and an edge to each frame that is there.

    Vertex 2k is the pose of the k-th frame's place, 2k + 1 the frame. An edge says that the two are at the same place,
    with an information that grows with the odds of the match.
    """
    lines = []
    for number, one in enumerate(located):
        pose = one.answer.pose
        if pose is None:
            continue
        where = f"{pose.x:.6f} {pose.y:.6f} {pose.heading:.9f}"
        odds = one.answer.probability / max(1 - one.answer.probability, 1e-6)
        lines.append(f"VERTEX_SE2 {2 * number} {where}\nFIX {2 * number}\nVERTEX_SE2 {2 * number + 1} {where}\n")
        lines.append(f"EDGE_SE2 {2 * number} {2 * number + 1} 0 0 0 {odds:.6g} 0 0 {odds:.6g} 0 {odds:.6g}\n")
    return "".join(lines)


def hloc_pairs_text(located: Sequence[LocatedFrame]) -> str:
    """Pairs of image names for hloc: the frame, and the frame of the map."""
    return "".join(f"{one.frame} {one.answer.drive}/{one.answer.database_frame}\n" for one in located)
