"""Directories as trees of files, and that archives of them are the same trees."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed
from tests.importing.packing import pack, pack_files

from everplace.errors import RouteError
from everplace.files import readable
from everplace.importing.containers.archive_tree import ArchivePath
from everplace.importing.containers.file_trees import TreePath, files_below
from everplace.importing.foreign_route import Encoded

HIDDEN = (".hidden.png", "b/._9.jpg", ".git/1.png")
NAMES = ("0.png", "b/10.PNG", "b/9.jpg", "b/notes.txt", "a/deep/er/1.webp", "a/deep2.bmp", "png")


def make(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(name.encode())
    return root


def answers(path: TreePath) -> dict[str, Any]:
    said: dict[str, Any] = {"file": path.is_file(), "directory": path.is_dir()}
    if said["file"]:
        with path.open() as file:
            said["content"] = file.read()
    if said["directory"]:
        said |= {"children": path.children(), "files": sorted(path.files())}
    return said


def test_a_directory_and_an_archive_of_it_hold_the_same_images(tmp_path: Path) -> None:
    folder = TreePath(make(tmp_path / "f", *NAMES, *HIDDEN))
    packed = ArchivePath(pack(tmp_path / "f", tmp_path / "f.tar.gz", "./"))
    assert folder.images == ("0.png", "a/deep2.bmp", "a/deep/er/1.webp", "b/9.jpg", "b/10.PNG")
    assert set(packed.images) == set(folder.images)
    assert (folder.name, packed.name) == ("f", "f")
    wanted = ["b/10.PNG", "0.png"]
    assert list(folder.read(wanted)) == [(name, tmp_path / "f" / name) for name in wanted]
    assert dict(packed.read(wanted)) == {"b/10.PNG": Encoded(b"b/10.PNG", ".PNG"), "0.png": Encoded(b"0.png", ".png")}


@fuzzed(60)
@given(st.lists(st.sampled_from(["a", "b", "deep", "er", ".", "..", "10.PNG", "1.webp", "notes.txt"]), max_size=4))
def test_a_directory_and_an_archive_of_it_answer_alike(tmp_path: Path, parts: list[str]) -> None:
    if not (tmp_path / "f").exists():
        pack(make(tmp_path / "f", *NAMES, *HIDDEN), tmp_path / "f.zip")
    name = "/".join(parts)
    if ".." in os.path.normpath(name):
        assert answers(ArchivePath(tmp_path / "f.zip") / name) == {"file": False, "directory": False}
    elif ".." not in parts:
        assert answers(ArchivePath(tmp_path / "f.zip") / name) == answers(TreePath(tmp_path / "f") / name)


def test_names_that_no_disk_takes_are_not_there(tmp_path: Path) -> None:
    for name in ("a" * 5000, "a\0b"):
        assert not (TreePath(tmp_path) / name).is_file()
        assert not (TreePath(tmp_path) / name).is_dir()


def test_a_directory_that_holds_itself_ends(tmp_path: Path) -> None:
    make(tmp_path / "f", "a/1.png")
    (tmp_path / "f/a/again").symlink_to(tmp_path / "f", target_is_directory=True)
    assert TreePath(tmp_path / "f").images == ("a/1.png",)


def test_a_missing_directory_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="cannot list .*gone: No such file or directory"):
        TreePath(tmp_path / "gone").children()
    with pytest.raises(RouteError, match="cannot list .*gone/b: No such file"):
        list((TreePath(tmp_path / "gone") / "b").files())


def test_files_are_found_down_to_a_level(tmp_path: Path) -> None:
    make(tmp_path, "10.zip", "9.zip", "a/1.zip", "a/b/2.zip", "a/notes.txt", ".h/3.zip")
    assert list(files_below(tmp_path, lambda name: name.endswith(".zip"), 1)) == ["9.zip", "10.zip", "a/1.zip"]


def test_a_link_to_itself_is_named(tmp_path: Path) -> None:
    (tmp_path / "query").mkdir()
    (tmp_path / "query/loop").symlink_to("loop")
    with pytest.raises(RouteError, match=r"cannot follow the link .*query/loop: .*; remove it or mend it"):
        (TreePath(tmp_path) / "query").children()


def test_paths_are_used_like_those_of_the_disk(tmp_path: Path) -> None:
    make(tmp_path, "set/a/list.txt")
    packed = ArchivePath(pack_files(tmp_path / "set.tar.gz", [("a/list.txt", b"set/a/list.txt")]))
    for top, where in ((TreePath(tmp_path / "set"), "set"), (packed, "set.tar.gz")):
        file = top / "a" / "list.txt"
        assert (top.name, file.name, file.parent.name, file.parent.parent.name) == ("set", "list.txt", "a", "set")
        assert file.is_file()
        assert (top / "a").is_dir()
        assert not (top / "b").is_dir()
        assert (top / "a").children() == ([], ["list.txt"])
        with file.open() as opened:
            assert opened.read() == b"set/a/list.txt"
        assert readable(file) == str(tmp_path / where / "a/list.txt")
        assert file.is_on_disk == (where == "set")
    assert (TreePath(tmp_path / "set").parent / "set/a/list.txt").is_file()
    assert packed.parent is packed


def test_an_absolute_name_is_one_on_the_disk(tmp_path: Path) -> None:
    make(tmp_path, "pairs.txt")
    place = ArchivePath(pack_files(tmp_path / "a.zip", [("1.png", b"")])) / str(tmp_path / "pairs.txt")
    assert place.is_on_disk
    assert place.is_file()
    assert place.name == "pairs.txt"
