from __future__ import annotations

from pathlib import Path

import pytest

from everplace.errors import RouteError
from everplace.route.times import read_times


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
def test_mistakes_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "times.csv").write_text(text)
    with pytest.raises(RouteError, match=message):
        read_times(tmp_path / "times.csv", ("a",))
