"""The page of what was matched: numbers of every frame, and pictures of each kind of pair."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.mapping.self_teaching import FrameMatches, SurePairs
from everplace.mapping.taught_drive import TaughtDrive
from everplace.mapping.teaching_report import ShownDrive, write_teaching_report

COUNT = 40


def shown(sure: NDArray[np.bool_], *, known: bool = True, wrong: tuple[int, ...] = ()) -> ShownDrive:
    """A drive whose frame i shows place i, with odds that fall; `wrong` frames were matched with others."""
    places = np.arange(COUNT)
    places[list(wrong)] = (places[list(wrong)] + 20) % COUNT
    odds = np.linspace(8, -4, COUNT, dtype=np.float32)
    frames = np.flatnonzero(sure)
    pairs = SurePairs(frames, places[frames], odds[frames], COUNT, FrameMatches(places, odds))
    stems = [f"{index:03d}" for index in range(COUNT)]
    drive = TaughtDrive("winter", stems, stems, pairs, np.arange(COUNT) if known else None)

    def grey(index: int) -> NDArray[np.uint8]:
        return np.full((8, 16, 3), index, np.uint8)

    return ShownDrive(drive, grey, grey)


def page_of(tmp_path: Path, *drives: ShownDrive) -> str:
    write_teaching_report(tmp_path, "summer", drives, {"method": "hog16"})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pairs.json", "report.html"]
    return (tmp_path / "report.html").read_text()


def test_it_says_how_much_how_surely_and_how_rightly(tmp_path: Path) -> None:
    page = page_of(tmp_path, shown(np.arange(COUNT) < 20, wrong=(3, 30)))
    assert "Of the 40 frames of winter, 20 (50%) found their place surely, 95.0% of these rightly." in page
    assert page.count("data:image/webp") == 4, "sure, borderline, refused and wrong pairs"
    told = json.loads((tmp_path / "pairs.json").read_text())
    assert (told["map"], told["log_odds"], told["run"]) == ("summer", 2.0, 10)
    (drive,) = told["drives"]
    assert (drive["pairs"], drive["right"], len(drive["matches"])) == (20, 0.95, COUNT)
    assert [row["frame"] for row in drive["matches"] if row["right"] is False] == ["003", "030"]


def test_without_a_truth_nothing_is_called_right(tmp_path: Path) -> None:
    page = page_of(tmp_path, shown(np.arange(COUNT) < 20, known=False), shown(np.zeros(COUNT, np.bool_), known=False))
    assert "found their place surely. Of the 40" in page
    written = re.sub(r"<svg.*?</svg>|data:[^\"]*", "", page[page.index("<main>") :], flags=re.DOTALL)
    assert not re.search("right|wrong", written)
    assert json.loads((tmp_path / "pairs.json").read_text())["drives"][1]["right"] is None


@pytest.mark.parametrize(("taught", "kinds"), [(0, 2), (COUNT, 2), (20, 3)])
def test_a_kind_without_pairs_is_said(tmp_path: Path, taught: int, kinds: int) -> None:
    page = page_of(tmp_path, shown(np.arange(COUNT) < taught))
    assert page.count("data:image/webp") == kinds
    missing = {0: ("sure", "wrong"), COUNT: ("refused", "wrong"), 20: ("wrong",)}[taught]
    assert all(f"There is nothing {what}." in page for what in missing)
