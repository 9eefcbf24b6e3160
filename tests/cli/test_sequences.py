"""--sequence and --sequence-method as the commands take them."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from everplace.choices import SEQUENCE_METHODS, SequenceMethod
from everplace.cli import main
from everplace.describe.files.descriptors import load_descriptors
from everplace.match.similarity import similarity
from everplace.sequences.sequence_search import search_sequences


def call(*arguments: str | Path) -> tuple[int, str]:
    """Status and stderr of a command."""
    err = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, err.getvalue()


def evaluated(route: Path, out: Path, *options: str) -> tuple[dict[str, object], str]:
    arguments: list[str | Path] = ["--method", "hog", "--database", "summer", "--query", "winter", "--out", out]
    status, err = call("evaluate", route, *arguments, *options)
    assert status == 0, err
    return json.loads((out / "metrics.json").read_text()), (out / "report.html").read_text()


def test_the_method_is_named_where_it_is_on(tiny_route: Path, tmp_path: Path) -> None:
    metrics, page = evaluated(tiny_route, tmp_path / "default", "--sequence", "4")
    assert metrics["sequence"] == 4
    assert metrics["sequence_method"] == "filter"
    assert "sequences of 4 (filter, stops not counted)" in page
    metrics, page = evaluated(tiny_route, tmp_path / "one")
    assert metrics["sequence"] == 1
    assert metrics["sequence_method"] is None
    assert "sequences of" not in page


@pytest.mark.slow
def test_a_comparison_names_it_too(tiny_route: Path, tmp_path: Path) -> None:
    how = ["--sequence", "3", "--sequence-method", "seqslam"]
    status, err = call("compare", tiny_route, "--methods", "hog", *how, "--out", tmp_path)
    assert status == 0, err
    assert json.loads((tmp_path / "metrics.json").read_text())["sequence_method"] == "seqslam"
    assert "sequences of 3 (seqslam)" in (tmp_path / "table.md").read_text()


@pytest.mark.parametrize("method", SEQUENCE_METHODS)
def test_matches_are_those_of_the_search(tiny_route: Path, tmp_path: Path, method: SequenceMethod) -> None:
    files = {name: tmp_path / f"{name}.h5" for name in ("summer", "winter")}
    for name, file in files.items():
        assert call("describe", "hog", tiny_route / name, "--out", file)[0] == 0
    out = tmp_path / "matches.csv"
    options: list[str | Path] = ["--top", "2", "--sequence", "3", "--sequence-method", method, "--out", out]
    status, err = call("match", files["summer"], files["winter"], *options)
    assert status == 0, err
    summer, winter = load_descriptors(files["summer"]), load_descriptors(files["winter"])
    S = search_sequences(similarity(winter, summer), 3, method)
    rows = list(csv.DictReader(out.read_text().splitlines()))
    best = [row for row in rows if row["rank"] == "1"]
    assert [row["database"] for row in best] == [summer.names[j] for j in S.argmax(axis=1)]
    np.testing.assert_array_equal(np.array([float(row["score"]) for row in best], S.dtype), S.max(axis=1))
    assert len(rows) == 2 * len(winter)


@pytest.mark.parametrize("command", ["match", "evaluate", "compare", "show"])
def test_another_method_is_refused_by_name(tiny_route: Path, tmp_path: Path, command: str) -> None:
    pair = ["--database", "summer", "--query", "winter", "--method", "hog"]
    arguments: dict[str, list[str | Path]] = {
        "match": ["match", "a.h5", "b.h5"],
        "evaluate": ["evaluate", tiny_route, *pair],
        "compare": ["compare", tiny_route, "--methods", "hog"],
        "show": ["show", "matrix", tiny_route, *pair],
    }
    status, err = call(*arguments[command], "--sequence-method", "dtw", "--out", tmp_path / "out.png")
    assert status == 2
    assert "Invalid value for '--sequence-method': 'dtw' is not one of 'filter', 'seqslam', 'mean'" in err
