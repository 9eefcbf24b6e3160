"""Match files read back by the rules of those who read them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from everplace.errors import ConfigError, DescriptorsError, StorageError
from everplace.match.match_file import write_matches

QUERY = ["q0", "q,1"]
DATABASE = ["d0", "Fähre", "d2"]
INDICES = np.array([[2, 0], [1, 2]])
SCORES = np.array([[0.1, -0.25], [1 / 3, 1e-8]], np.float32)


def test_csv_gives_everything_back(tmp_path: Path) -> None:
    path = tmp_path / "new" / "matches.csv"
    write_matches(path, QUERY, DATABASE, INDICES, SCORES, kind="cosine")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["query"], row["database"], row["rank"]) for row in rows] == [
        ("q0", "d2", "1"),
        ("q0", "d0", "2"),
        ("q,1", "Fähre", "1"),
        ("q,1", "d2", "2"),
    ]
    assert np.array([row["score"] for row in rows]).astype(np.float32).tolist() == SCORES.ravel().tolist()
    assert path.read_bytes().count(b"\r") == 0


def test_hloc_pairs_are_two_names_a_line(tmp_path: Path) -> None:
    path = tmp_path / "pairs.txt"
    write_matches(path, QUERY, DATABASE, INDICES, SCORES, format="hloc-pairs", kind="cosine")
    pairs = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    assert pairs == [["q0", "d2"], ["q0", "d0"], ["q,1", "Fähre"], ["q,1", "d2"]]


def test_kapture_pairs_are_query_map_score(tmp_path: Path) -> None:
    path = tmp_path / "pairs.txt"
    write_matches(path, ["q0"], DATABASE, INDICES[:1], SCORES[:1], format="kapture", kind="cosine")
    assert path.read_text(encoding="utf-8").splitlines() == [
        "# kapture format: 1.1",
        "# query_image, map_image, score",
        "q0, d2, 0.100000001",
        "q0, d0, -0.25",
    ]


def test_a_name_that_is_not_utf8_keeps_its_bytes(tmp_path: Path) -> None:
    path = tmp_path / "matches.csv"
    write_matches(path, ["a\udcff"], ["b"], np.array([[0]]), np.ones((1, 1), np.float32), kind="cosine")
    assert b"a\xff,b,1,1,cosine\n" in path.read_bytes()


@pytest.mark.parametrize(
    ("format", "name"),
    [("hloc-pairs", "a b"), ("hloc-pairs", ""), ("kapture", "a,b"), ("kapture", " a"), ("kapture", "#a")],
)
def test_a_name_that_the_format_cannot_hold_is_refused(tmp_path: Path, format: Any, name: str) -> None:
    path = tmp_path / "pairs.txt"
    for query, database in (([name], ["d"]), (["q"], [name])):
        with pytest.raises(DescriptorsError, match=f"{format} cannot hold the name"):
            write_matches(
                path, query, database, np.array([[0]]), np.ones((1, 1), np.float32), format=format, kind="cosine"
            )
    assert list(tmp_path.iterdir()) == []


def test_misuse_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "matches.csv"
    with pytest.raises(ConfigError, match="`format` 'xml' is not known; choose csv, hloc-pairs, kapture"):
        write_matches(path, QUERY, DATABASE, INDICES, SCORES, format="xml", kind="cosine")  # type: ignore[arg-type]
    with pytest.raises(DescriptorsError, match=r"\(2, 2\).*\(1, 2\)"):
        write_matches(path, QUERY, DATABASE, INDICES, SCORES[:1], kind="cosine")
    with pytest.raises(DescriptorsError, match="1 queries"):
        write_matches(path, QUERY[:1], DATABASE, INDICES, SCORES, kind="cosine")
    (tmp_path / "file").touch()
    with pytest.raises(StorageError):
        write_matches(tmp_path / "file" / "matches.csv", QUERY, DATABASE, INDICES, SCORES, kind="cosine")
