from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import ConfigError, RouteError
from everplace.route.natural_order import natural_key, natural_sorted
from everplace.route.traverse import Traverse
from everplace.route.truth import (
    TruthPair,
    TruthTable,
    tolerance_band,
    truth_by_pose,
    truth_by_position,
    write_truth,
)


def drive(stems: list[str], positions: list[tuple[float, float]] | None = None) -> Traverse:
    poses = None if positions is None else np.array([(x, y, 0.0) for x, y in positions]).reshape(-1, 3)
    return Traverse("t", "c", Path("/r/t"), tuple(stems), (".png",) * len(stems), poses)


stem_lists = st.lists(st.integers(0, 30), unique=True, max_size=10).map(
    lambda numbers: natural_sorted(["anchor", *map(str, numbers)])
)


def test_tolerance_counts_places_not_digits() -> None:
    query, database = drive(["10", "20", "50"]), drive(["10", "20", "50"])
    assert truth_by_position(query, database, 1).tolist() == [
        [True, True, False],
        [True, True, True],
        [False, True, True],
    ]


@settings(max_examples=50, deadline=None)
@given(
    query=st.lists(st.integers(-40, 40), max_size=9),
    database=st.lists(st.integers(-40, 40), max_size=9),
    tolerance=st.integers(0, 90),
)
def test_a_band_is_what_is_at_most_so_many_places_apart(query: list[int], database: list[int], tolerance: int) -> None:
    band = tolerance_band(query, database, tolerance)
    assert band.shape == (len(query), len(database))
    assert band.tolist() == [[abs(row - column) <= tolerance for column in database] for row in query]


@pytest.mark.parametrize("tolerance", [3, 2**63 - 1, 10**20])
def test_a_tolerance_beyond_the_route_makes_all_places_the_same(tolerance: int) -> None:
    assert truth_by_position(drive(["1", "3"]), drive(["2", "3", "4"]), tolerance).all()


def test_places_that_only_one_side_has_are_counted() -> None:
    assert truth_by_position(drive(["1", "3"]), drive(["1", "2", "3"]), 1).tolist() == [
        [True, True, False],
        [False, True, True],
    ]


def test_places_that_neither_side_has_any_more_are_counted_where_told() -> None:
    way = [str(place) for place in range(30)]
    asked, few = drive(["0", "10", "20"]), drive(["0", "1", "11", "12", "20"])
    assert truth_by_position(asked, few, 1, way).tolist() == [
        [True, True, False, False, False],
        [False, False, True, False, False],
        [False, False, False, False, True],
    ]


def test_frames_in_any_order() -> None:
    shuffled = drive(["1", "2", "3", "4"]).take([2, 0, 3, 1])
    truth = truth_by_position(shuffled, drive(["1", "2", "3", "4"]), 0)
    assert np.argmax(truth, axis=1).tolist() == [2, 0, 3, 1]
    np.testing.assert_array_equal(truth_by_position(drive(["1", "2", "3", "4"]), shuffled, 0), truth.T)


@given(stem_lists, stem_lists, st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_truth_against_its_definition(query: list[str], database: list[str], tolerance: int) -> None:
    truth = truth_by_position(drive(query), drive(database), tolerance)

    places = sorted(set(query) | set(database), key=natural_key)
    expected = [[abs(places.index(a) - places.index(b)) <= tolerance for b in database] for a in query]
    np.testing.assert_array_equal(truth, np.array(expected))
    np.testing.assert_array_equal(truth_by_position(drive(database), drive(query), tolerance), truth.T)
    assert (truth <= truth_by_position(drive(query), drive(database), tolerance + 1)).all()
    same = np.array([[a == b for b in database] for a in query])
    np.testing.assert_array_equal(truth_by_position(drive(query), drive(database), 0), same)


def test_no_shared_stem_and_negative_tolerance() -> None:
    with pytest.raises(RouteError, match="share no stem"):
        truth_by_position(drive(["1"]), drive(["2"]), 1)
    with pytest.raises(ConfigError, match="tolerance -1 is negative"):
        truth_by_position(drive(["1"]), drive(["1"]), -1)


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 80.0))
@settings(max_examples=30, deadline=None)
def test_truth_by_pose_against_brute_force(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    here, there = rng.uniform(-50, 50, (7, 2)), rng.uniform(-50, 50, (11, 2))
    query = drive([str(i) for i in range(7)], [(float(x), float(y)) for x, y in here])
    database = drive([str(i) for i in range(11)], [(float(x), float(y)) for x, y in there])

    truth = truth_by_pose(query, database, radius)

    expected = np.hypot(*(here[:, None] - there[None]).transpose(2, 0, 1)) <= radius
    np.testing.assert_array_equal(truth, expected)
    np.testing.assert_array_equal(truth_by_pose(database, query, radius), truth.T)


def test_the_radius_is_included() -> None:
    query, database = drive(["1"], [(0.0, 0.0)]), drive(["1", "2"], [(3.0, 4.0), (3.0, 4.001)])
    assert truth_by_pose(query, database, 5.0).tolist() == [[True, False]]


@pytest.mark.parametrize("radius", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_radius(radius: float) -> None:
    with pytest.raises(ConfigError, match="radius"):
        truth_by_pose(drive(["1"], [(0, 0)]), drive(["1"], [(0, 0)]), radius)


def test_missing_poses_name_the_remedy() -> None:
    with pytest.raises(RouteError, match=r"'t' has no poses; put a poses\.csv"):
        truth_by_pose(drive(["1"], [(0, 0)]), drive(["1"]), 5.0)


def named(name: str, stems: list[str]) -> Traverse:
    return Traverse(name, name, Path("/r") / name, tuple(stems), (".png",) * len(stems))


QUERY, DATABASE = named("q", ["a", "b", "c"]), named("d", ["a", "x", "y", "z"])


def table(path: Path, text: str) -> TruthTable:
    path.write_text(text, encoding="utf-8")
    return TruthTable(path, (QUERY, DATABASE))


HEADER = "query_traverse,query,database_traverse,database\n"


def test_pairs_hold_in_both_directions(tmp_path: Path) -> None:
    truth = table(tmp_path / "t.csv", HEADER + "q,a,d,x\nq,a,d,y\nq,c,d,a\n\nd,z,q,b\nq,a,d,x\n")
    expected = np.array([[0, 1, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]], dtype=bool)
    np.testing.assert_array_equal(truth.matches(QUERY, DATABASE), expected)
    np.testing.assert_array_equal(truth.matches(DATABASE, QUERY), expected.T)


def test_frames_that_a_filter_left_out_do_not_shift_the_others(tmp_path: Path) -> None:
    truth = table(tmp_path / "t.csv", HEADER + "q,a,d,x\nq,c,d,z\n")
    found = truth.matches(QUERY.take([2, 1]), DATABASE.take([3, 0, 2]))
    np.testing.assert_array_equal(found, np.array([[1, 0, 0], [0, 0, 0]], dtype=bool))


def test_columns_in_any_order_and_pairs_within_one_traverse(tmp_path: Path) -> None:
    truth = table(tmp_path / "t.csv", "note,database,query,query_traverse,database_traverse\n,y,x,d,d\n")
    expected = np.zeros((4, 4), dtype=bool)
    expected[1, 2] = expected[2, 1] = True
    np.testing.assert_array_equal(truth.matches(DATABASE, DATABASE), expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lacks the column 'query_traverse'"),
        ("query_traverse,query,database_traverse\n", "lacks the column 'database'"),
        (HEADER + "q,a\n", "row 2 has 2 cells, but the first line names 4 columns"),
        (HEADER + "q,a,d,x,0\n", "row 2 has 5 cells, but the first line names 4 columns"),
        (HEADER + "q,a,d,x\nq,n,d,x\n", "row 3 names the frame 'n', which the traverse 'q' does not have"),
        (HEADER + "q,a,d,n\n", "row 2 names the frame 'n', which the traverse 'd' does not have"),
        (HEADER + "q,a,e,x\n", "names the traverse 'e', which the route does not have; there are: q, d"),
        (HEADER + 'q,"a,d,x\n', "is not a UTF-8 CSV file"),
        (HEADER + "d,x,d,y\n", "holds no pair of 'q' and 'd', only of 'd' and 'd'"),
        (HEADER, "holds no pair of 'q' and 'd', only of nothing"),
    ],
)
def test_a_wrong_file_of_pairs_names_row_and_stem(tmp_path: Path, text: str, message: str) -> None:
    truth = table(tmp_path / "t.csv", text)
    with pytest.raises(RouteError, match=message) as caught:
        truth.matches(QUERY, DATABASE)
    assert str(tmp_path / "t.csv") in str(caught.value)


def test_a_missing_file_of_pairs(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match=r"t\.csv does not exist; add the file, or correct `truth`"):
        TruthTable(tmp_path / "t.csv", (QUERY, DATABASE))


any_stem = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=4)


@given(st.lists(any_stem, unique=True, min_size=1, max_size=6), st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, stems: list[str], seed: int) -> None:
    path = tmp_path_factory.mktemp("truth") / "truth.csv"
    query, database = named("q, 1", stems), named("d", stems)
    expected = np.random.default_rng(seed).random((len(stems), len(stems))) < 0.4
    expected[0, 0] = True
    pairs = [TruthPair("q, 1", stems[i], "d", stems[j]) for i, j in np.argwhere(expected)]
    assert write_truth(path, pairs) == len(pairs)
    np.testing.assert_array_equal(TruthTable(path, (query, database)).matches(query, database), expected)


@given(st.text(max_size=60))
@fuzzed(60)
def test_any_text_is_a_truth_or_one_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("truth") / "truth.csv"
    path.write_bytes((HEADER + "q,a,d,x\n" + text).encode("utf-8", "surrogatepass"))
    try:
        assert TruthTable(path, (QUERY, DATABASE)).matches(QUERY, DATABASE)[0, 1]
    except RouteError as error:
        assert "truth.csv" in str(error)
