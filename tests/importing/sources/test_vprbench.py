"""VPR-Bench: numbered images and an object array of true matches."""

from __future__ import annotations

import os
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.sources import vprbench
from everplace.route.selection import Selection
from everplace.scoring.retrieval import MatchRule, choose_pair, retrieve, true_matches

MATCHES: list[list[Any]] = [[0, [1, 2]], [1, np.array([0])], [2, []]]


def write(data_set: Any, matches: list[list[Any]], *, queries: int = 3, references: int = 4) -> None:
    data_set.images("query", [f"{index:07d}.jpg" for index in range(queries)])
    data_set.images("ref", [f"{index:07d}.jpg" for index in range(references)])
    table = np.empty((len(matches), 2), dtype=object)
    for index, row in enumerate(matches):
        table[index, 0], table[index, 1] = row
    np.save(data_set.root / "ground_truth_new.npy", table, allow_pickle=True)


def test_matches_become_pairs_by_stem(data_set: Any) -> None:
    write(data_set, MATCHES)
    assert [tuple(pair) for pair in data_set.pairs(vprbench)] == [
        ("query", "query-0000000", "ref", "ref-0000001"),
        ("query", "query-0000000", "ref", "ref-0000002"),
        ("query", "query-0000001", "ref", "ref-0000000"),
    ]
    frames = data_set.frames(vprbench)
    assert [frame.stem for frame in frames["ref"]] == [f"ref-{index:07d}" for index in range(4)]
    assert data_set.read(vprbench).notes == ("1 of 3 queries have no true match.",)
    assert data_set.pairs(vprbench, same_names=True)[0] == ("query", "0000000", "ref", "0000001")


def test_an_import_is_evaluated_by_its_pairs(data_set: Any) -> None:
    write(data_set, MATCHES)
    route = data_set.imported("vprbench")
    assert route.truth_origin == "the data set's list of true matches, ground_truth_new.npy"
    pair = choose_pair(route, "query", "ref", Selection())
    truth, resolved = true_matches(pair, MatchRule())
    assert str(resolved) == "pairs of truth.csv"
    assert truth.astype(int).tolist() == [[0, 1, 1, 0], [1, 0, 0, 0], [0, 0, 0, 0]]
    result = retrieve(route, "query", "ref", "hog")
    assert result.scores is not None
    assert (result.scores.queries, result.scores.queries_with_match, result.scores.database) == (3, 2, 4)


def test_a_hostile_truth_runs_nothing(data_set: Any) -> None:
    class Hostile:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(data_set.root / "pwned"),)

    write(data_set, [[0, [Hostile()]]])
    with pytest.raises(RouteError, match="unsafe: it wants to call posix.mkdir"):
        data_set.read(vprbench)
    assert not (data_set.root / "pwned").exists()


@pytest.mark.parametrize(
    ("matches", "message"),
    [
        ([[3, [0]]], r"row 0: the query 3 does not exist, there are 3 images"),
        ([[0, [4]]], r"row 0: the reference 4 does not exist, there are 4 images"),
        ([[0, [-1]]], "the reference -1 does not exist"),
        ([[0, [1]], [1, [5, 4]]], "row 1: the reference 4 does not exist, there are 4 images"),
        ([[0, [1]], [3, [1, 4]]], "row 1: the query 3 does not exist, there are 3 images"),
        ([[0, [0.5]]], r"the reference is 0\.5 where the index of an image must be"),
        ([[0, [float("nan")]]], "the reference is nan"),
        ([[[0], [1]]], r"the query is \[0\]"),
        ([[0, [1]], [0, [2]]], "row 1 speaks of the query 0 a second time"),
        ([[0, []]], "holds no true match"),
        ([[0, ["a"]]], "more than lists of numbers"),
    ],
)
def test_a_wrong_truth_is_named(data_set: Any, matches: list[list[Any]], message: str) -> None:
    write(data_set, matches)
    with pytest.raises(RouteError, match=message) as caught:
        data_set.read(vprbench)
    assert "ground_truth_new.npy" in str(caught.value)


@pytest.mark.parametrize(
    ("matches", "kept", "note"),
    [
        (
            [[0, [2, 3, 4]], [1, [3, 4, 5]]],
            [(0, 2), (0, 3), (1, 3)],
            "3 references to .* dropped: 4, 5; there are",
        ),
        ([[0, [-2, -1, 0]]], [(0, 0)], "2 references to images that do not exist were dropped: -2, -1; there are 4"),
        ([[0, np.array([3, 10**6])]], [(0, 3)], "1 references to images that do not exist were dropped: 1000000;"),
        ([[0, list(range(2, 12))]], [(0, 2), (0, 3)], "8 references to .* dropped: 4, 5, 6, 7, 8 and 3 more; there"),
    ],
)
def test_references_past_the_ends_are_dropped_and_counted(
    data_set: Any, matches: list[list[Any]], kept: list[tuple[int, int]], note: str
) -> None:
    write(data_set, matches)
    assert [(int(query[6:]), int(reference[4:])) for _, query, _, reference in data_set.pairs(vprbench)] == kept
    assert re.match(note, data_set.read(vprbench).notes[0])


def test_the_published_truth_of_gardens_point(data_set: Any) -> None:
    """200 queries and references, ±2 each: 3 references of the last two queries lie past the end."""
    write(data_set, [[n, [m for m in range(n - 2, n + 3) if m >= 0]] for n in range(20)], queries=20, references=20)
    route = data_set.imported("vprbench")
    pair = choose_pair(route, "query", "ref", Selection())
    truth, _ = true_matches(pair, MatchRule())
    assert truth.sum(axis=1).tolist() == [3, 4, *[5] * 16, 4, 3]
    assert data_set.read(vprbench).notes == (
        "3 references to images that do not exist were dropped: 20, 21; there are 20 images from 0 on.",
    )


def test_missing_parts(data_set: Any) -> None:
    with pytest.raises(RouteError, match="query does not exist"):
        data_set.read(vprbench)
    write(data_set, MATCHES)
    (data_set.root / "ground_truth_new.npy").unlink()
    with pytest.raises(RouteError, match=r"cannot read .*ground_truth_new\.npy"):
        data_set.read(vprbench)


@given(position=st.integers(0, 600), piece=st.binary(min_size=1, max_size=4), kept=st.integers(1, 2000))
@fuzzed(60)
def test_a_fuzzed_truth_gives_pairs_or_one_error(data_set: Any, position: int, piece: bytes, kept: int) -> None:
    path = data_set.root / "fuzzed.npy"
    table = np.empty((3, 2), dtype=object)
    for index, row in enumerate(MATCHES):
        table[index, 0], table[index, 1] = row
    np.save(path, table, allow_pickle=True)
    data = bytearray(path.read_bytes())
    data[position : position + len(piece)] = piece
    path.write_bytes(data[:kept])
    try:
        truth, _ = vprbench._read_truth(TreePath(path), 3, 4)
    except RouteError as error:
        assert "fuzzed.npy" in str(error)
    else:
        assert all(0 <= query < 3 and all(0 <= match < 4 for match in found) for query, found in truth.items())
