from __future__ import annotations

import importlib.util
import io
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image
from tests.importing.packing import pack

from everplace.cli.main import run
from everplace.errors import MissingExtraError, RouteError
from everplace.images.frame_names import choose_frames, counted_endings
from everplace.importing.containers.archive_tree import open_trees
from everplace.importing.containers.file_trees import TreePath, image_names
from everplace.importing.import_route import import_route
from everplace.route.folder import open_traverse
from everplace.route.route import open_route

JPEG = io.BytesIO()
Image.new("RGB", (16, 12), (90, 60, 30)).save(JPEG, "JPEG")


def make(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(JPEG.getvalue())
    return root


def test_what_is_passed_over_is_counted_by_ending() -> None:
    names = ["a.DNG", "b.dng", "c.gif", "notes.txt", "e.mcap.zstd"]
    assert counted_endings(names, (".dng", ".gif", ".mcap.zstd")) == "2 × .dng, 1 × .gif, 1 × .mcap.zstd"


@pytest.mark.parametrize(
    ("name", "told"),
    [("x.CR2", "1 × .cr2"), ("x.dng", "1 × .dng"), ("x.gif", "1 × .gif"), ("x.mp4", "1 × .mp4"), ("x.bag", "1 × .bag")],
)
def test_a_traverse_names_what_it_passes_over(tmp_path: Path, name: str, told: str) -> None:
    make(tmp_path, "route/a/0.jpg", "route/a/notes.txt", f"route/a/{name}")
    for opened in (lambda: open_route(tmp_path / "route"), lambda: open_traverse(tmp_path / "route/a")):
        with pytest.warns(UserWarning, match=f"a holds pictures or recordings that are not read: {told};"):
            opened()
    with pytest.warns(UserWarning, match=told):
        import_route("images", tmp_path / "route", tmp_path / "out")


@pytest.mark.parametrize("command", [["data", "inspect", "route"], ["describe", "hog", "route/a", "--out", "a.h5"]])
def test_a_command_says_it_once(
    tmp_path: Path, command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, "route/a/0.jpg", "route/a/1.nef")
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        monkeypatch.setattr(warnings, "showwarning", lambda message, *_, **__: print(f"said {message}"))
        assert run(command) == 0
    assert capsys.readouterr().out.count("1 × .nef") == 1


@pytest.mark.parametrize("kind", ["images", "nordland", "gardens_point"])
def test_only_pictures_that_are_passed_over_are_an_error(tmp_path: Path, kind: str) -> None:
    names = {"nordland": ("winter/1.nef", "summer/1.nef"), "gardens_point": ("day_left/1.nef",)}
    make(tmp_path, *(f"data/{name}" for name in names.get(kind, ("day/1.nef", "day/2.nef"))))
    with pytest.raises(RouteError, match=r"× \.nef|holds no|neither"):
        import_route(kind, tmp_path / "data", tmp_path / "out")


@pytest.mark.parametrize(
    "opened",
    [open_traverse, lambda path: open_route(path.parent), lambda path: image_names(TreePath(path)), open_trees],
)
def test_a_directory_of_nothing_else_is_an_error_that_counts(tmp_path: Path, opened: Callable[[Path], object]) -> None:
    make(tmp_path, "route/a/0.NEF", "route/a/1.nef", "route/a/2.gif")
    with pytest.raises(RouteError, match=r"it holds pictures that are not read \(1 × \.gif, 2 × \.nef\)"):
        opened(tmp_path / "route/a")


@pytest.mark.parametrize("archived", [False, True])
@pytest.mark.parametrize("ending", [".HEIC", ".heif", ".AVIF"])
def test_of_a_picture_twice_the_one_that_was_always_read_is_taken(tmp_path: Path, ending: str, archived: bool) -> None:
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    make(tmp_path, "route/a/0.jpg", "route/a/1.jpg", f"route/a/1{ending}", f"route/a/2{ending}")
    wanted = ["0.jpg", "1.jpg", f"2{ending}"]
    source = pack(tmp_path / "route/a", tmp_path / "a.zip") if archived else tmp_path / "route/a"
    with pytest.warns(UserWarning, match=rf"holds 1 pictures twice, such as \S*1\{ending} and \S*1\.jpg"):
        (tree,) = open_trees(source)
    assert sorted(tree.images) == wanted
    with pytest.warns(UserWarning, match="holds 1 pictures twice"):
        traverse = open_traverse(tmp_path / "route/a")
    assert [path.name for path in traverse.paths] == wanted


def test_pictures_that_were_always_refused_twice_still_are(tmp_path: Path) -> None:
    with pytest.raises(RouteError, match="two frames of the same stem"):
        open_traverse(make(tmp_path / "a", "1.jpg", "1.png"))


@pytest.mark.parametrize("command", [open_traverse, lambda path: import_route("images", path, path.parent / "out")])
def test_without_the_extra_the_file_and_the_extra_are_named(
    tmp_path: Path, command: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path, "a/0.jpg", "a/1.HEIC")
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pillow_heif" else find(name))
    with pytest.raises(MissingExtraError, match=r"a/1\.HEIC needs an optional .*everplace\[heif\]"):
        command(tmp_path / "a")
    make(tmp_path, "a/1.jpg")
    with pytest.warns(UserWarning, match="holds 1 pictures twice"):
        command(tmp_path / "a")


def test_names_are_chosen_in_their_order(tmp_path: Path) -> None:
    assert choose_frames(tmp_path, ["b.png", "x.txt", "a.jpg"]) == ["b.png", "a.jpg"]
