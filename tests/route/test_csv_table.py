from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.route.csv_table import read_columns, read_table


def test_columns_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text("seconds, note ,stem\n1.5,x,a\n\n-2e3,,b\n")
    assert [(row.number, row.key, row.numbers) for row in read_table(path, "stem", ("seconds",), "")] == [
        (2, "a", (1.5,)),
        (4, "b", (-2000.0,)),
    ]
    assert read_columns(path) == ["seconds", "note", "stem"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stem\na\n", r"times.csv lacks the column 'seconds' in its first line; it must name stem, seconds"),
        ("stem,seconds\na,soon\n", "row 2 must hold a stem and a number; correct it"),
        ("stem,seconds\na,nan\n", "row 2 holds a number that is not finite"),
        ('stem,seconds\n"a,1\n', "not a UTF-8 CSV file"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text)
    with pytest.raises(RouteError, match=message):
        list(read_table(path, "stem", ("seconds",), ""))


def test_a_missing_file_comes_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match=r"cannot read .*none.csv: No such file or directory; look again"):
        list(read_table(tmp_path / "none.csv", "stem", ("seconds",), "look again"))
    with pytest.raises(RouteError, match="cannot read"):
        read_columns(tmp_path / "none.csv")


@fuzzed(60)
@given(text=st.binary(max_size=60), header=st.booleans())
def test_any_bytes_give_rows_or_one_error(tmp_path: Path, text: bytes, header: bool) -> None:
    path = tmp_path / "fuzz.csv"
    path.write_bytes(b"stem,seconds\n" * header + text)
    try:
        rows = list(read_table(path, "stem", ("seconds",), ""))
    except RouteError as error:
        assert "fuzz.csv" in str(error)
    else:
        assert all(len(row.numbers) == 1 for row in rows)
