from __future__ import annotations

from pathlib import Path

import pytest

from everplace.errors import RouteError
from everplace.route.poses import read_poses


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
        ("stem,x,y,heading\na,1,2\n", "row 2 must hold a stem and three numbers"),
        ("stem,x,y,heading\na,1,2,east\n", "row 2 must hold a stem and three numbers"),
        ("stem,x,y,heading\nb,0,0,0\na,1,nan,0\n", "row 3 holds a number that is not finite"),
        ("stem,x,y,heading\na,1,2,0\na,1,2,0\n", "row 3 names the stem 'a' a second time"),
        ("stem,x,y,heading\nb,1,2,0\n", "no pose for 1 of 1 frames, the first is 'a'; add a line"),
        ('stem,x,y,heading\n"a,1,2,0\n', "not a UTF-8 CSV file"),
    ],
)
def test_mistakes_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
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
