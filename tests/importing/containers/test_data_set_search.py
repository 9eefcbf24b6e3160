"""Finding data sets in directories and archives."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.importing.packing import pack_files

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.data_set_search import find_data_set, find_directories
from everplace.importing.containers.file_trees import TreePath


def is_set(place: TreePath) -> bool:
    return (place / "list.txt").is_file()


def found(source: Path, *, apart: bool = False) -> list[str]:
    return [os.path.relpath(place, source) for place in find_directories(source, is_set, apart=apart).found]


def write(root: Path, *names: str) -> None:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)


def test_each_branch_is_searched_until_one_is_found(tmp_path: Path) -> None:
    write(tmp_path, "x/b10/list.txt", "x/b9/list.txt", "x/deep/er/list.txt", "x/b9/below/list.txt", ".h/list.txt")
    assert found(tmp_path) == ["x/b9", "x/b10", "x/deep/er"]
    assert found(tmp_path / "x/deep") == ["er"]
    write(tmp_path, "1/2/3/4/list.txt", "1/2/3/4b/5/list.txt")
    assert found(tmp_path / "1") == ["2/3/4", "2/3/4b/5"]
    assert found(tmp_path)[3:] == ["1/2/3/4"]
    write(tmp_path, "list.txt")
    assert found(tmp_path) == ["."]
    assert found(tmp_path / "x/deep/er") == ["."]


def test_a_directory_is_found_once_though_links_lead_to_it(tmp_path: Path) -> None:
    write(tmp_path, "real/list.txt", "other/x.txt")
    (tmp_path / "again").symlink_to("real")
    (tmp_path / "other/up").symlink_to("..")
    assert found(tmp_path) == ["real"]


def test_archives_of_a_directory_are_unpacked_together_or_apart(tmp_path: Path) -> None:
    for name in ("one.zip", "two.tgz", "sub/deep/three.tar"):
        pack_files(tmp_path / name, [("set/list.txt", b"")])
    assert found(tmp_path, apart=True) == ["one.zip/set", "two.tgz/set", "sub/deep/three.tar/set"]
    assert len(found(tmp_path)) == 2
    assert len(found(tmp_path / "sub")) == 1
    pack_files(tmp_path / "none.zip", [("readme.txt", b"")])
    write(tmp_path, "unpacked/list.txt")
    places = find_directories(tmp_path, is_set, apart=True)
    assert [place.name for place in places.found] == ["unpacked", "set", "set", "set"]
    assert places.notes == [f"{tmp_path / 'none.zip'} holds no sequence."]


def test_what_is_not_read_is_said(tmp_path: Path) -> None:
    write(tmp_path, "a/list.txt", "a/junk/old.zip", "more.tgz")
    places = find_directories(tmp_path, is_set)
    assert [place.name for place in places.found] == ["a"]
    assert len(places.notes) == 1
    assert "Not read" in places.notes[0]
    assert {"old.zip", "more.tgz"} <= {Path(word.strip(",.")).name for word in places.notes[0].split()}
    nested = pack_files(tmp_path / "n.zip", [("list.txt", b""), ("b/x.txt", b"")])
    assert find_directories(nested, is_set).notes == []
    nested = pack_files(tmp_path / "n.zip", [("a/list.txt", b""), ("b/more.zip", b"")])
    assert "n.zip/b/more.zip" in find_directories(nested, is_set).notes[0]


def test_pipes_and_directories_called_like_archives_are_none(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p.tar")
    write(tmp_path, "d.zip/list.txt")
    assert found(tmp_path, apart=True) == ["d.zip"]
    assert find_directories(tmp_path, is_set).notes == []


def test_one_data_set_is_wanted(tmp_path: Path) -> None:
    write(tmp_path, "a/list.txt", "b/list.txt", "c/other.txt")
    with pytest.raises(RouteError, match="/a and .*/b both hold a list; give one of them"):
        find_data_set(tmp_path, is_set, "a list")
    assert find_data_set(tmp_path, is_set, "a list", preferred="b")[0].name == "b"
    write(tmp_path, "d/a/list.txt", "d/b/c/list.txt")
    with pytest.raises(RouteError, match="d/a and .*d/b/c both hold a list"):
        find_data_set(tmp_path / "d", is_set, "a list")
    assert find_data_set(tmp_path / "a", is_set, "a list")[0].name == "a"
    assert readable(find_data_set(tmp_path / "c", is_set, "a list")[0]) == str(tmp_path / "c")
    archive = pack_files(tmp_path / "a.zip", [("c/other.txt", b"")])
    assert readable(find_data_set(archive, is_set, "a list")[0]) == str(archive)


def test_what_is_no_source_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "list.txt")
    with pytest.raises(RouteError, match=r"list\.txt is neither a directory nor a tar or zip archive; give the data"):
        found(tmp_path / "list.txt")
    with pytest.raises(RouteError, match="gone does not exist"):
        found(tmp_path / "gone")
