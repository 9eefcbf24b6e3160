from __future__ import annotations

import tarfile
import warnings
import zipfile
from pathlib import Path

import pytest

from everplace.data.archive_tree import ArchiveTree, open_trees
from everplace.data.file_trees import FolderTree
from everplace.data.sources.protocol import Encoded
from everplace.errors import RouteError


def make(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(name.encode())
    return root


def test_a_folder_and_an_archive_of_it_hold_the_same(tmp_path: Path) -> None:
    names = ("b/10.PNG", "b/9.jpg", "a/deep/er/1.webp", "0.png")
    make(tmp_path / "f", *names, ".hidden.png", "b/._9.jpg", "b/notes.txt", ".git/1.png", "png", "__MACOSX/b/9.txt")
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as archive:
        archive.add(tmp_path / "f", ".")
    folder, packed = FolderTree(tmp_path / "f"), ArchiveTree(tmp_path / "a.tar.gz")
    assert folder.images == ("0.png", "a/deep/er/1.webp", "b/9.jpg", "b/10.PNG")
    assert set(packed.images) == set(folder.images)
    wanted = ["b/10.PNG", "0.png"]
    assert list(folder.read(wanted)) == [(name, tmp_path / "f" / name) for name in wanted]
    assert dict(packed.read(wanted)) == {"b/10.PNG": Encoded(b"b/10.PNG", ".PNG"), "0.png": Encoded(b"0.png", ".png")}


def test_macos_leftovers_in_a_zip_are_no_images(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("winter/1.png", "__MACOSX/winter/1.png", "__MACOSX/winter/._1.png"):
            archive.writestr(name, b"")
    assert ArchiveTree(tmp_path / "a.zip").images == ("winter/1.png",)


def test_a_directory_that_holds_itself_ends(tmp_path: Path) -> None:
    make(tmp_path / "f", "a/1.png")
    (tmp_path / "f/a/again").symlink_to(tmp_path / "f", target_is_directory=True)
    assert FolderTree(tmp_path / "f").images == ("a/1.png",)


def test_a_name_twice_in_an_archive_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        archive.writestr("1.png", b"a")
        archive.writestr("1.png", b"b")
    with pytest.raises(RouteError, match=r"a\.zip holds '1\.png' twice"):
        ArchiveTree(tmp_path / "a.zip")


def test_archives_are_found_one_level_down(tmp_path: Path) -> None:
    make(tmp_path / "f", "1.png", "data/x.txt", "data/deeper/far.tar")
    with zipfile.ZipFile(tmp_path / "f/data/a.zip", "w") as archive:
        archive.writestr("2.png", b"")
    assert [(tree.path.name, tree.images) for tree in open_trees(tmp_path / "f")] == [
        ("f", ("1.png",)),
        ("a.zip", ("2.png",)),
    ]


def test_nothing_to_read_is_an_error(tmp_path: Path) -> None:
    make(tmp_path / "f", "readme.txt")
    with pytest.raises(RouteError, match="holds no image"):
        open_trees(tmp_path / "f")
    with pytest.raises(RouteError, match="neither a directory nor a tar or zip archive"):
        open_trees(tmp_path / "f/readme.txt")
