"""OpenSeqSLAM2's numbered images and its CSV of true matches."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.sources import openseqslam2


def write(data_set: Any, lines: list[str]) -> None:
    data_set.images("query", [f"images-{number:05d}.png" for number in range(1, 5)])
    data_set.images("reference", [f"images-{number:05d}.png" for number in range(1, 9)])
    data_set.text("ground_truth.csv", lines)


def found(data_set: Any, **options: Any) -> dict[str, list[str]]:
    matches: dict[str, list[str]] = {}
    for _, query, _, reference in data_set.pairs(openseqslam2, **options):
        matches.setdefault(query.rpartition("-")[2], []).append(reference.rpartition("-")[2])
    return matches


def test_numbers_count_from_one_and_ranges_end_with_the_images(data_set: Any) -> None:
    write(data_set, ["1,1,2", "2, 4, 0", "4,8,1", "4,3,0"])
    assert found(data_set) == {
        "00001": ["00001", "00002", "00003"], "00002": ["00004"], "00004": ["00003", "00007", "00008"],
    }  # fmt: skip
    assert data_set.read(openseqslam2).notes == ("1 of 4 queries have no true match.",)


def test_a_subsample_counts_the_images_that_were_used(data_set: Any) -> None:
    write(data_set, ["2,3,0"])
    assert found(data_set, subsample=2) == {"00003": ["00005"]}
    assert len(data_set.frames(openseqslam2, subsample=2)["reference"]) == 4


def test_lists_of_images_in_their_own_order(data_set: Any) -> None:
    write(data_set, ["1,1,0"])
    data_set.text("q.txt", ["query/images-00003.png", "query/images-00001.png"])
    assert [tuple(pair) for pair in data_set.pairs(openseqslam2, query="q.txt", same_names=True)] == [
        ("query", "query-images-00003", "reference", "images-00001")
    ]
    frames = data_set.frames(openseqslam2, query="q.txt")["query"]
    assert [frame.content.name for frame in frames] == ["images-00003.png", "images-00001.png"]


def test_an_import_keeps_the_pairs(data_set: Any) -> None:
    write(data_set, ["1,1,2", "2,4,0"])
    route = data_set.imported("openseqslam2")
    assert route.truth_origin == "the data set's list of true matches, ground_truth.csv"
    assert route.truth is not None
    assert route.truth.matches(route["query"], route["reference"]).sum() == 4


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["0,1,0"], r"ground_truth\.csv, line 1 names the query 0, but there are 4, counted from 1"),
        (["1,1,0", "5,1,0"], "line 2 names the query 5"),
        (["1,9,0"], "line 1 names the reference 9, but there are 8"),
        (["1,1,-1"], "holds the tolerance -1"),
        (["1,1"], "holds 2 numbers"),
        (["1,1,0,0"], "holds 4 numbers"),
        (["1,1.5,0"], r"holds '1\.5' where the number of a reference must be"),
        (["query,reference,tolerance"], "holds 'query' where the number of a query must be"),
        ([], "holds no true match"),
    ],
)
def test_a_wrong_truth_is_named(data_set: Any, lines: list[str], message: str) -> None:
    write(data_set, lines)
    with pytest.raises(RouteError, match=message):
        data_set.read(openseqslam2)


@given(st.text(st.sampled_from("0123456789,.-e# \n"), max_size=40))
@fuzzed(80)
def test_any_numbers_give_positions_or_one_error(data_set: Any, text: str) -> None:
    path = data_set.text("fuzzed.csv", [text])
    try:
        truth = openseqslam2._read_truth(TreePath(path), 4, 8)
    except RouteError as error:
        assert "fuzzed.csv" in str(error)
    else:
        assert all(
            0 <= query < 4 and all(0 <= one.start < one.stop <= 8 for one in ranges) for query, ranges in truth.items()
        )
