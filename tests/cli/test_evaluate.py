"""`everplace evaluate` and `everplace show` on drives of which nobody knows what is right."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from everplace.cli import main
from everplace.images.decoding import ImageSpec, decode_image

NULL = ("recall_at", "auc_pr", "average_precision", "recall_at_100_precision", "extended_precision", "tolerance")


@pytest.fixture
def unaligned(tiny_route: Path) -> Path:
    for path in list((tiny_route / "winter").glob("*.png")):
        path.rename(path.with_name(f"q{path.name}"))
    (tiny_route / "winter" / "q11.png").unlink()
    return tiny_route


@pytest.mark.parametrize(
    ("method", "options", "kind"),
    [
        ("hog", (), "cosine"),
        ("sad", ("--tolerance", "3"), "negative-difference"),
        ("hog", ("--sequence", "3", "--standardise", "centre"), "log-odds"),
    ],
)
def test_drives_that_are_not_aligned_get_what_can_be_given(
    unaligned: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    method: str,
    options: tuple[str, ...],
    kind: str,
) -> None:
    out = tmp_path / "out"
    pair = ["--method", method, "--query", "winter", "--database", "summer", *options]
    assert main.run(["evaluate", str(unaligned), *pair, "--out", str(out), "--json"]) == 0
    told = capsys.readouterr()
    assert "everplace: there are no scores: the traverses 'winter' and 'summer' share no stem" in told.err
    assert "`everplace data align`" in told.err
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics == json.loads(told.out)
    assert [metrics[name] for name in NULL] == [None] * len(NULL)
    assert (metrics["queries"], metrics["database"]) == (11, 12)
    with (out / "best_matches.csv").open(newline="") as file:
        matches = list(csv.DictReader(file))
    assert [match["query"] for match in matches] == [f"q{place}" for place in range(11)]
    assert {match["score_kind"] for match in matches} == {kind}
    scores = [float(match["score"]) for match in matches]
    assert metrics["match_scores"]["kind"] == kind
    for name, value in {"lowest": min(scores), "median": np.median(scores), "highest": max(scores)}.items():
        assert metrics["match_scores"][name] == pytest.approx(value, rel=1e-6)
    for picture in ("matches.png", "similarity.png"):
        assert decode_image(out / picture, ImageSpec()).shape[1] > 500
    page = (out / "report.html").read_text("utf-8")
    assert "There are no scores: the traverses" in page
    assert "<dt>recall@1</dt>" not in page
    assert "nan" not in page.lower().split("plotly")[0]


@pytest.mark.parametrize("picture", ["matches", "matrix"])
def test_pictures_of_drives_that_are_not_aligned(
    unaligned: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], picture: str
) -> None:
    out = tmp_path / "picture.png"
    pair = ["--method", "sad", "--query", "winter", "--database", "summer"]
    assert main.run(["show", picture, str(unaligned), *pair, "--out", str(out)]) == 0
    assert "there are no scores" in capsys.readouterr().err
    assert decode_image(out, ImageSpec()).shape[1] > 500
