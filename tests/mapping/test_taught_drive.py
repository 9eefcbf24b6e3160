"""What one drive taught, in numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from everplace.mapping.self_teaching import FrameMatches, SurePairs
from everplace.mapping.taught_drive import TaughtDrive, places_by_name

MAP_STEMS = ("a", "b", "c", "d")


def taught(stems: tuple[str, ...], sure: list[int], *, known: bool = True) -> TaughtDrive:
    """Four frames that were matched with the places 0, 1, 3 and 3."""
    places, odds = np.array([0, 1, 3, 3]), np.array([5, 3, 2.5, -1], np.float32)
    pairs = SurePairs(np.array(sure, np.int64), places[sure], odds[sure], 4, FrameMatches(places, odds))
    return TaughtDrive("w", stems, MAP_STEMS, pairs, places_by_name(stems, MAP_STEMS) if known else None)


def test_the_share_that_is_right_counts_a_neighbour() -> None:
    assert taught(("a", "b", "c", "d"), [0, 1, 2]).right == 1.0
    assert taught(("a", "d", "b", "x"), [0, 1, 2]).right == pytest.approx(1 / 3)
    assert taught(("a", "b", "x", "d"), [0, 1, 2]).right == pytest.approx(2 / 3), (
        "a place that the map has not is wrong"
    )


@pytest.mark.parametrize(
    ("stems", "sure", "known"),
    [(("a", "b", "c", "d"), [0], False), (("w", "x", "y", "z"), [0, 1], True), (("a", "b", "c", "d"), [], True)],
    ids=["no truth", "no shared name", "no pair"],
)
def test_where_it_cannot_be_told_it_is_not(stems: tuple[str, ...], sure: list[int], known: bool) -> None:
    drive = taught(stems, sure, known=known)
    assert drive.right is None
    assert drive.summary() == {"name": "w", "frames": 4, "pairs": len(sure), "share": len(sure) / 4, "right": None}


def test_every_frame_has_a_row() -> None:
    rows = list(taught(("a", "c", "b", "d"), [0, 1]).rows())
    assert json.loads(json.dumps(rows)) == rows
    assert [(row["frame"], row["place"], row["sure"], row["right"]) for row in rows] == [
        ("a", "a", True, True), ("c", "b", True, True), ("b", "d", False, False), ("d", "d", False, True)
    ]  # fmt: skip
    assert [row["log_odds"] for row in rows] == [5, 3, 2.5, -1]
    assert rows[3]["probability"] == pytest.approx(1 / (1 + np.e), abs=1e-6)
    assert {row["right"] for row in taught(("a", "c", "b", "d"), [0], known=False).rows()} == {None}
