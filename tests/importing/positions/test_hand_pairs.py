from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.positions.hand_pairs import read_pairs

DRIVES = {"winter": ["a", "b", "c", "d"], "summer": ["0", "1", "2", "3", "4"], "night": ["x", "y", "z"]}
TWO = {"winter": DRIVES["winter"], "summer": DRIVES["summer"]}


def write(directory: Path, text: str) -> Path:
    path = directory / "pairs.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_are_called_like_the_drives_and_cells_may_be_empty(tmp_path: Path) -> None:
    path = write(tmp_path, "\ufeffnight, summer ,note,winter\nx,0,begin,a\ny,,,b\n\n,3,,c\nz,4,end,d\n")
    pairs = read_pairs(path, "winter", DRIVES)
    assert {name: found.tolist() for name, found in pairs.items()} == {
        "summer": [[0, 0], [2, 3], [3, 4]],
        "night": [[0, 0], [1, 1], [3, 2]],
    }


def test_two_drives_may_be_a_and_b(tmp_path: Path) -> None:
    path = write(tmp_path, "stem_a,stem_b\n0,b\n4,d\n")
    assert read_pairs(path, "summer", TWO)["winter"].tolist() == [[0, 1], [4, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no column for 'winter' in its first line; it must name the drives, like winter,summer,night"),
        ("winter,summer\na,0\nd,4\n", "no column for 'night'"),
        ("stem_a,stem_b\na,0\nd,4\n", "no column for 'winter'"),
        ("winter,summer,night\na,0,x\nd,5,z\n", "row 3 names the frame '5', which 'summer' does not have"),
        ("winter,summer,night\nb,1,x\na,2,y\n", "row 3 holds the pair 'a', '2', which goes back or stays"),
        ("winter,summer,night\na,1,x\nb,1,y\n", "row 3 holds the pair 'b', '1', which goes back or stays"),
        ("winter,summer,night\na,0,x\nd,4,\n", "holds 1 pairs of 'winter' and 'night'; give at least two"),
        ('winter,summer,night\n"a,0,x\n', "not a UTF-8 CSV file"),
        ("winter,summer,night\na,0,x,y\n", "row 2 has 4 cells, but the first line names 3 columns"),
        ("winter,summer,night\na,0\n", "row 2 has 2 cells, but the first line names 3 columns"),
    ],
)
def test_mistakes_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(RouteError, match=message) as caught:
        read_pairs(path, "winter", DRIVES)
    assert str(path) in str(caught.value)


def test_missing_and_not_utf8(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="cannot read"):
        read_pairs(tmp_path / "gone.csv", "winter", DRIVES)
    (tmp_path / "latin.csv").write_bytes(b"winter,caf\xe9\n")
    with pytest.raises(RouteError, match="not a UTF-8 CSV file"):
        read_pairs(tmp_path / "latin.csv", "winter", DRIVES)


@given(st.text(alphabet='abcd01234\n,"\r\0 ;winterso_ump', max_size=60) | st.lists(
    st.tuples(st.sampled_from(["a", "b", "c", "d", ""]), st.sampled_from(["0", "1", "2", "3", "4"])), max_size=5
).map(lambda rows: "\n".join(["stem_a,stem_b", *(",".join(row) for row in rows)])))  # fmt: skip
@fuzzed(60)
def test_fuzzed_text_gives_rising_pairs_or_one_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as directory:
        try:
            pairs = read_pairs(write(Path(directory), text), "winter", TWO)["summer"]
            assert len(pairs) >= 2
            assert (np.diff(pairs, axis=0) > 0).all()
        except RouteError as error:
            assert "\n" not in str(error)
