from __future__ import annotations

import os
from pathlib import Path

import pytest

from everplace.errors import RouteError
from everplace.route.folder import open_traverse, read_traverses
from everplace.route.route_toml import RouteToml, TraverseToml

PLAIN = RouteToml()


def make(root: Path, *files: str) -> Path:
    for file in files:
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).touch()
    return root


def test_order_is_natural_and_endings_are_kept(tmp_path: Path) -> None:
    make(tmp_path, "t10/10.png", "t10/9.JPG", "t10/1.webp", "t9/a.b.jpeg", "t9/01.tif", "t9/1.tiff")
    traverses = read_traverses(tmp_path, PLAIN)
    assert [traverse.name for traverse in traverses] == ["t9", "t10"]
    assert traverses[0].stems == ("01", "1", "a.b")
    assert [path.name for path in traverses[1].paths] == ["1.webp", "9.JPG", "10.png"]
    assert all(path.exists() for traverse in traverses for path in traverse.paths)


def test_jpeg_files_as_browsers_save_them_are_frames(tmp_path: Path) -> None:
    make(tmp_path, "a/IMG_0.jpg", "a/IMG_1.jfif", "a/IMG_2.JFIF", "b/x.jfif")
    assert [traverse.stems for traverse in read_traverses(tmp_path, PLAIN)] == [("IMG_0", "IMG_1", "IMG_2"), ("x",)]


def test_frames_named_by_seconds_that_lost_trailing_zeros_are_in_the_order_of_time(tmp_path: Path) -> None:
    make(tmp_path, "day/5.5.png", "day/5.125.jpg", "day/5.0.png", "day/5.25.png", "day/10.05.png")
    assert read_traverses(tmp_path, PLAIN)[0].stems == ("5.0", "5.125", "5.25", "5.5", "10.05")


def test_hidden_and_other_files_are_left_out(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "a/.2.png", "a/notes.txt", "a/png", "a/sub.png/x.txt", ".git/1.png", "cover.png")
    (traverse,) = read_traverses(tmp_path, PLAIN)
    assert traverse.stems == ("1",)


def test_a_dead_link_stays_a_frame(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png")
    (tmp_path / "a/2.png").symlink_to(tmp_path / "nowhere.png")
    assert read_traverses(tmp_path, PLAIN)[0].stems == ("1", "2")


def test_two_frames_of_one_stem(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "a/7.png", "a/7.jpg")
    with pytest.raises(RouteError, match=r"a holds 7\.jpg and 7\.png, two frames of the same stem"):
        read_traverses(tmp_path, PLAIN)
    chosen = RouteToml(traverses={"a": TraverseToml(pattern="*.png")})
    assert read_traverses(tmp_path, chosen)[0].stems == ("1", "7")


def test_a_pattern_chooses_files_of_any_ending(tmp_path: Path) -> None:
    make(tmp_path, "a/left_1.raw", "a/left_2.raw", "a/right_1.raw", "a/plain")
    settings = RouteToml(traverses={"a": TraverseToml(pattern="left_*")})
    assert read_traverses(tmp_path, settings)[0].stems == ("left_1", "left_2")
    settings = RouteToml(traverses={"a": TraverseToml(pattern="pl*n")})
    assert read_traverses(tmp_path, settings)[0].paths == (tmp_path / "a" / "plain",)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([], "holds no traverse; make one sub-directory"),
        (["readme.txt"], "holds no traverse"),
        (
            ["1.png", "2.png"],
            "holds images itself, so it is a single traverse and not a route; give the directory above",
        ),
        (
            ["a/1.png", "b/notes.txt"],
            r"traverse .*/b is empty: no file in it ends in \.avif.*`ignore` in route\.toml",
        ),
    ],
)
def test_what_is_no_route(tmp_path: Path, files: list[str], message: str) -> None:
    with pytest.raises(RouteError, match=message):
        read_traverses(make(tmp_path, *files), PLAIN)


def test_missing_route_and_file_as_route(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="gone does not exist"):
        read_traverses(tmp_path / "gone", PLAIN)
    make(tmp_path, "file")
    with pytest.raises(RouteError, match="file is not a directory"):
        read_traverses(tmp_path / "file", PLAIN)


def test_ignored_directories_and_directories_of_poses(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "thumbs/1.txt", "poses/a.csv")
    (tmp_path / "poses/a.csv").write_text("stem,x,y,heading\n1,2,3,0.5\n")
    settings = RouteToml(ignore=("thumbs",), traverses={"a": TraverseToml(poses="poses/a.csv")})
    (traverse,) = read_traverses(tmp_path, settings)
    assert traverse[0].pose == (2.0, 3.0, 0.5)


def test_poses_csv_in_the_traverse_is_found(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "a/2.png", "b/1.png")
    (tmp_path / "a/poses.csv").write_text("stem,x,y,heading\n2,20,0,0\n1,10,0,0\n")
    with_poses, without = read_traverses(tmp_path, PLAIN)
    assert with_poses.poses is not None
    assert with_poses.poses[:, 0].tolist() == [10.0, 20.0]
    assert without.poses is None


def test_a_directory_alone_has_no_poses_to_be_wrong(tmp_path: Path) -> None:
    make(tmp_path, "a/2.png", "a/10.png")
    (tmp_path / "a/poses.csv").write_text("nonsense")
    traverse = open_traverse(tmp_path / "a")
    assert (traverse.name, traverse.condition, traverse.stems, traverse.poses) == ("a", "a", ("2", "10"), None)
    with pytest.raises(RouteError, match="gone does not exist"):
        open_traverse(tmp_path / "gone")


def test_settings_of_a_traverse_that_is_not_there(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "b/1.png")
    with pytest.raises(RouteError, match=r"route\.toml speaks of the traverse 'c', .* there are: a, b"):
        read_traverses(tmp_path, RouteToml(traverses={"c": TraverseToml()}))


def test_names_that_are_not_utf8_are_refused_by_name(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png", "a/3.png")
    raw = os.fsencode(tmp_path)
    with open(raw + b"/a/caf\xe9.txt", "wb"), open(raw + b"/a/2\xff.png", "wb"):  # noqa: PTH123
        pass
    with pytest.raises(RouteError) as caught:
        read_traverses(tmp_path, PLAIN)
    assert str(caught.value).endswith(r"/a/2\xff.png is not UTF-8; rename it")
    os.unlink(raw + b"/a/2\xff.png")  # noqa: PTH108
    assert read_traverses(tmp_path, PLAIN)[0].stems == ("1", "3")
    os.mkdir(raw + b"/\xe9")  # noqa: PTH102
    with pytest.raises(RouteError, match=r"/\\xe9 is not UTF-8"):
        read_traverses(tmp_path, PLAIN)


def test_utf8_names_are_fine(tmp_path: Path) -> None:
    assert read_traverses(make(tmp_path, "été/café 1.png"), PLAIN)[0].stems == ("café 1",)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may list everything")
def test_a_directory_that_may_not_be_listed(tmp_path: Path) -> None:
    make(tmp_path, "a/1.png")
    (tmp_path / "a").chmod(0)
    try:
        with pytest.raises(RouteError, match="cannot list .*/a: Permission denied"):
            read_traverses(tmp_path, PLAIN)
    finally:
        (tmp_path / "a").chmod(0o700)
