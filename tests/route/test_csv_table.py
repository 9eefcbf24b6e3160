from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.route.csv_table import CsvTable, read_poses, read_times


def written(directory: Path, text: str) -> Path:
    path = directory / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_in_any_order(tmp_path: Path) -> None:
    table = CsvTable(written(tmp_path, "seconds, note ,stem,note\n1.5,x,a,z\n\n-2e3,,b,\n"), ("stem", "seconds"))
    assert table.columns == ["seconds", "note", "stem", "note"]
    assert [(row.number, dict(row.cells)) for row in table] == [
        (2, {"seconds": "1.5", "note": "x", "stem": "a"}),
        (4, {"seconds": "-2e3", "note": "", "stem": "b"}),
    ]
    assert [row.floats(("seconds",), "a number") for row in table] == [[1.5], [-2000.0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stem\na\n", r"table.csv lacks the column 'seconds' in its first line; it must name stem, seconds"),
        ("stem,seconds\na,soon\n", "row 2 must hold a number; correct it"),
        ("stem,seconds\na,nan\n", "row 2 holds a number that is not finite"),
        ('stem,seconds\n"a,1\n', "not a UTF-8 CSV file"),
        ("stem,seconds\na,1\nb,2,5\n", "row 3 has 3 cells, but the first line names 2 columns; .*decimal comma"),
        ("stem,seconds\n\na\n", "row 3 has 1 cells, but the first line names 2 columns"),
        ('seconds,stem\n"1,5",a\n', "row 2 must hold a number"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RouteError, match=message):
        [row.floats(("seconds",), "a number") for row in CsvTable(written(tmp_path, text), ("stem", "seconds"))]


@pytest.mark.parametrize("text", ["stem,seconds\na,1,,\n", "stem,seconds,,\na,1\n", "stem,seconds,\na,1,\n"])
def test_empty_cells_at_the_end_count_as_none(tmp_path: Path, text: str) -> None:
    table = CsvTable(written(tmp_path, text))
    assert table.columns == ["stem", "seconds"]
    assert [dict(row.cells) for row in table] == [{"stem": "a", "seconds": "1"}]


@pytest.mark.parametrize("row", ["b,1,5,0,0", "b,1,0,0,5", "b,1.5,0"])
def test_a_decimal_comma_shifts_no_pose(tmp_path: Path, row: str) -> None:
    path = written(tmp_path, f"stem,x,y,heading\na,0,0,0\n{row}\n")
    with pytest.raises(RouteError, match=rf"table\.csv, row 3 has {row.count(',') + 1} cells, .* names 4 columns"):
        read_poses(path, ("a", "b"))


def test_a_missing_file_comes_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match=r"cannot read .*none.csv: No such file or directory; look again"):
        CsvTable(tmp_path / "none.csv", remedy="look again")


@fuzzed(60)
@given(text=st.binary(max_size=60), header=st.booleans())
def test_any_bytes_give_rows_or_one_error(tmp_path: Path, text: bytes, header: bool) -> None:
    path = tmp_path / "fuzz.csv"
    path.write_bytes(b"stem,seconds\n" * header + text)
    try:
        rows = list(CsvTable(path, ("stem", "seconds")))
    except RouteError as error:
        assert "fuzz.csv" in str(error)
    else:
        assert all({"stem", "seconds"} <= row.cells.keys() for row in rows)


def test_poses_are_joined_by_stem(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    text = '\ufeffheading, stem ,note,x,y\n0.5,b,"x, y",1,2\n\n0,a,,3e2,-4\n9,other,,9,9\n'
    path.write_text(text, encoding="utf-8")
    poses = read_poses(path, ("a", "b"))
    assert poses.tolist() == [[300.0, -4.0, 0.0], [1.0, 2.0, 0.5]]
    assert not poses.flags.writeable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lacks the column 'stem'"),
        ("stem,x,y\na,1,2\n", "lacks the column 'heading'"),
        ("stem,x,y,heading\na,1,2\n", "row 2 has 3 cells, but the first line names 4 columns"),
        ("stem,x,y,heading\na,1,2,east\n", "row 2 must hold a stem and three numbers"),
        ("stem,x,y,heading\nb,0,0,0\na,1,nan,0\n", "row 3 holds a number that is not finite"),
        ("stem,x,y,heading\na,1,2,0\na,1,2,0\n", "row 3 names the stem 'a' a second time"),
        ("stem,x,y,heading\nb,1,2,0\n", "no pose for 1 of 1 frames, the first is 'a'; add a line"),
        ('stem,x,y,heading\n"a,1,2,0\n', "not a UTF-8 CSV file"),
    ],
)
def test_mistakes_in_poses_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(RouteError, match=message) as caught:
        read_poses(path, ("a",))
    assert str(path) in str(caught.value)


def test_not_utf8_and_missing(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    with pytest.raises(RouteError, match=r"cannot read .*poses\.csv"):
        read_poses(path, ("a",))
    path.write_bytes(b"stem,x,y,heading\ncaf\xe9,1,2,3\n")
    with pytest.raises(RouteError, match="not a UTF-8 CSV file"):
        read_poses(path, ("a",))


def test_times_are_joined_by_stem(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text("seconds,stem\n2.5,b\n-1,a\n7,other\n")
    times = read_times(path, ("a", "b"))
    assert times.tolist() == [-1.0, 2.5]
    assert not times.flags.writeable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stem\na\n", "lacks the column 'seconds'"),
        ("stem,seconds\na,noon\n", "row 2 must hold a stem and a number"),
        ("stem,seconds\na,1\na,1\n", "row 3 names the stem 'a' a second time; keep one time for each frame"),
        ("stem,seconds\nb,1\n", "no time for 1 of 1 frames, the first is 'a'; add a line"),
    ],
)
def test_mistakes_in_times_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "times.csv").write_text(text)
    with pytest.raises(RouteError, match=message):
        read_times(tmp_path / "times.csv", ("a",))
