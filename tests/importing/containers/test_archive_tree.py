"""Archives as trees of files: links, names that come twice, what is held in memory."""

from __future__ import annotations

import os
import tarfile
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tests.importing.packing import pack_files

from everplace.errors import RouteError
from everplace.importing.containers import archive_listing, archives
from everplace.importing.containers.archive_tree import ArchivePath, open_trees
from everplace.importing.foreign_route import Encoded


def linked(path: Path, files: dict[str, bytes], links: dict[str, tuple[bytes, str]]) -> Path:
    pack_files(path, files.items())
    with tarfile.open(path, "a") as archive:
        for name, (kind, target) in links.items():
            info = tarfile.TarInfo(name)
            info.type, info.linkname = kind, target
            archive.addfile(info)
    return path


def test_links_to_files_are_followed(tmp_path: Path) -> None:
    links = {
        "b/2.png": (tarfile.LNKTYPE, "./a/1.png"),
        "b/3.png": (tarfile.SYMTYPE, "../a/1.png"),
        "b/4.png": (tarfile.SYMTYPE, "3.png"),
        "list.txt": (tarfile.SYMTYPE, "a/list.txt"),
    }
    tree = ArchivePath(linked(tmp_path / "a.tar", {"a/1.png": b"1", "a/list.txt": b"text"}, links))
    assert tree.images == ("a/1.png", "b/2.png", "b/3.png", "b/4.png")
    assert dict(tree.read(["b/4.png", "a/1.png", "b/2.png"])) == {
        name: Encoded(b"1", ".png") for name in ("a/1.png", "b/2.png", "b/4.png")
    }
    assert (tree / "list.txt").open().read() == b"text"


@pytest.mark.parametrize(
    ("name", "target"), [("b", "a"), ("b/2.png", "gone.png"), ("b/2.png", "2.png"), ("b/2.png", "../b/2.png")]
)
def test_links_to_no_file_are_refused(tmp_path: Path, name: str, target: str) -> None:
    path = linked(tmp_path / "a.tar", {"a/1.png": b"1"}, {name: (tarfile.SYMTYPE, target)})
    with pytest.raises(RouteError, match=rf"a\.tar holds the link '{name}' to '.*', which is no file in it"):
        ArchivePath(path)


def test_hidden_files_are_not_listed_but_links_and_lists_lead_to_them(tmp_path: Path) -> None:
    links = {
        "a/2.png": (tarfile.SYMTYPE, "../.git/annex/key.png"),
        ".git/broken": (tarfile.SYMTYPE, "gone"),
    }
    files = {".git/annex/key.png": b"2", "a/1.png": b"1", "a/.x/3.txt": b"3"}
    tree = ArchivePath(linked(tmp_path / "a.tar", files, links))
    assert tree.images == ("a/1.png", "a/2.png")
    assert tree.children() == (["a"], [])
    assert (tree / "a").children() == ([], ["1.png", "2.png"])
    assert list(tree.files()) == ["a/1.png", "a/2.png"]
    assert dict(tree.read(["a/2.png", ".git/annex/key.png"])) == {
        name: Encoded(b"2", ".png") for name in ("a/2.png", ".git/annex/key.png")
    }
    assert (tree / "a/.x/3.txt").open().read() == b"3"
    assert (tree / "a/.x").is_dir()


def test_a_hidden_file_that_comes_twice_does_no_harm(tmp_path: Path) -> None:
    tree = ArchivePath(pack_files(tmp_path / "a.zip", [("1.png", b"1"), (".DS_Store", b"a"), (".DS_Store", b"b")]))
    assert tree.images == ("1.png",)
    assert not (tree / ".DS_Store").is_file()


def test_messages_name_the_archive_and_what_it_calls_the_member(tmp_path: Path) -> None:
    first = pack_files(tmp_path / "sub/a.zip", [("x/1.png", b"1")])
    second = pack_files(tmp_path / "b.tar", [("sub/x/1.png", b"1"), ("y/2.png", b"2")])
    tree = ArchivePath(tmp_path, [("sub", first), ("", second)])
    assert os.fspath(tree / "sub/x/1.png") == str(first / "x/1.png")
    assert os.fspath(tree / "sub/x") == str(first / "x")
    assert os.fspath(tree / "y/2.png") == str(second / "y/2.png")
    assert os.fspath(tree / "gone") == str(tmp_path / "gone")
    assert os.fspath(tree / "") == str(tmp_path)
    assert os.fspath(ArchivePath(second) / "gone") == str(second / "gone")
    with pytest.raises(RouteError, match=r"a\.zip and .*b\.tar both hold 'x/1\.png'"):
        list(tree.read(["sub/x/1.png"]))


def test_macos_leftovers_in_a_zip_are_no_images(tmp_path: Path) -> None:
    names = ("winter/1.png", "__MACOSX/winter/1.png", "__MACOSX/winter/._1.png", ".DS_Store")
    tree = ArchivePath(pack_files(tmp_path / "a.zip", ((name, b"") for name in names)))
    assert tree.images == ("winter/1.png",)
    assert tree.children() == (["winter"], [])


@pytest.mark.parametrize("name", ["1.png", "list.txt"])
def test_a_name_twice_in_an_archive_is_refused(tmp_path: Path, name: str) -> None:
    path = pack_files(tmp_path / "a.zip", [(name, b"a"), (name, b"b")])
    with pytest.raises(RouteError, match=rf"a\.zip holds '{name}' twice"):
        ArchivePath(path)


def test_a_name_in_two_archives_is_refused_when_it_is_read(tmp_path: Path) -> None:
    first = pack_files(tmp_path / "a.zip", [("1.png", b"1"), ("same.txt", b"s"), ("other.txt", b"a")])
    second = pack_files(tmp_path / "b.tar", [("1.png", b"1"), ("same.txt", b"s"), ("other.txt", b"b"), ("2.png", b"2")])
    tree = ArchivePath(tmp_path, [("", first), ("", second)])
    assert tree.images == ("1.png", "2.png")
    assert (tree / "same.txt").open().read() == b"s"
    assert list(tree.read(["2.png"])) == [("2.png", Encoded(b"2", ".png"))]
    for read in (lambda: (tree / "other.txt").open(), lambda: list(tree.read(["1.png"]))):
        with pytest.raises(RouteError, match=r"a\.zip and .*b\.tar both hold '(other\.txt|1\.png)'; keep one of them"):
            read()
    apart = ArchivePath(tmp_path, [("a", first), ("b/c", second)])
    assert (apart / "b/c/other.txt").open().read() == b"b"
    assert [name for name, _ in apart.read(["b/c/1.png", "a/1.png"])] == ["b/c/1.png", "a/1.png"]


@pytest.mark.parametrize("form", ["zip", "tar", "tar.gz"])
def test_what_is_not_kept_is_read_again_up_to_a_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    files = [("small.txt", b"s"), ("list.txt", b"0" * 100), ("large.txt", b"0" * 1000), ("1.png", b"1")]
    monkeypatch.setattr(archive_listing, "_MOST_KEPT", 10)
    monkeypatch.setattr(archives, "MAX_FILE_BYTES", 100)
    path = pack_files(tmp_path / f"a.{form}", files)
    tree = ArchivePath(path)
    assert (tree / "list.txt").open().read() == b"0" * 100
    with pytest.raises(RouteError, match=rf"a\.{form} holds large\.txt of 1000 bytes, more than the 100"):
        (tree / "large.txt").open()
    with pytest.raises(RouteError, match=r"cannot read .*gone\.txt: No such file"):
        (tree / "gone.txt").open()
    with pytest.raises(RouteError, match=r"gone\.png does not exist"):
        list(tree.read(["gone.png"]))
    pack_files(path, files[:1])
    assert (tree / "small.txt").open().read() == b"s"
    with pytest.raises(RouteError, match=r"no longer holds list\.txt"):
        (tree / "list.txt").open()
    with pytest.raises(RouteError, match=r"no longer holds 1\.png"):
        list(tree.read(["1.png"]))


@pytest.mark.parametrize("form", ["zip", "tar", "tar.gz"])
def test_one_image_is_in_memory_at_a_time(tmp_path: Path, form: str) -> None:
    size, count = 2**18, 24
    picture = np.random.default_rng(0).bytes(size)
    path = pack_files(tmp_path / f"a.{form}", ((f"{number}.png", picture) for number in range(count)))
    tracemalloc.start()
    try:
        tree = ArchivePath(path)
        assert sum(len(content.data) for _, content in tree.read(tree.images) if isinstance(content, Encoded)) == (
            size * count
        )
        assert tracemalloc.get_traced_memory()[1] < 6 * size
    finally:
        tracemalloc.stop()


def test_archives_are_found_one_level_down(tmp_path: Path) -> None:
    for name in ("1.png", "data/x.txt", "data/deeper/far.tar"):
        (tmp_path / "f" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "f" / name).write_bytes(b"")
    pack_files(tmp_path / "f/data/a.zip", [("2.png", b"")])
    assert [(tree.name, tree.images) for tree in open_trees(tmp_path / "f")] == [
        ("f", ("1.png",)),
        ("a", ("2.png",)),
    ]


def test_nothing_to_read_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "readme.txt").write_text("")
    with pytest.raises(RouteError, match="holds no image"):
        open_trees(tmp_path)
    with pytest.raises(RouteError, match="neither a directory nor a tar or zip archive"):
        open_trees(tmp_path / "readme.txt")
    with zipfile.ZipFile(tmp_path / "empty.zip", "w"):
        pass
    with pytest.raises(RouteError, match=r"empty\.zip holds no file; get it again"):
        open_trees(tmp_path / "empty.zip")


def test_directories_are_listed_in_work_that_grows_with_the_names(tmp_path: Path) -> None:
    deep = "/".join("abcdefgh")
    tree = ArchivePath(pack_files(tmp_path / "a.zip", [(f"{deep}/1.png", b""), ("a/b/2.png", b""), ("3.png", b"")]))
    assert tree.children() == (["a"], ["3.png"])
    assert (tree / "a/b").children() == (["c"], ["2.png"])
    assert (tree / deep).children() == ([], ["1.png"])
    assert (tree / "a/b/c/d").is_dir()
