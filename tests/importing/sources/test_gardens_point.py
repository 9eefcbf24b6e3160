"""Gardens Point in the forms in which it circulates."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest

from everplace.errors import RouteError
from everplace.importing.foreign_route import Encoded
from everplace.importing.import_route import import_route
from everplace.importing.sources import gardens_point
from everplace.route.route import open_route


def test_the_original_form(data_set: Any) -> None:
    names = [f"Image{number:03d}.jpg" for number in (0, 1, 10, 199)]
    for traverse in ("day_left", "day_right", "night_right"):
        data_set.images(traverse, names)
    route = data_set.imported("gardens_point")
    assert route.truth_origin == "the data set's frame numbers, which are in step over the walks"
    assert route.tolerance == 3
    assert [traverse.name for traverse in route.traverses] == ["day_left", "day_right", "night_right"]
    assert route.conditions == ("day_left", "day_right", "night_right")
    assert route.shared_stems() == ("000", "001", "010", "199")


def test_the_archive_is_read_as_it_is_and_what_is_unpacked_counts_first(data_set: Any, tmp_path: Path) -> None:
    expected = {one: data_set.images(one, ["Image000.jpg", "Image010.jpg"]) for one in ("day_left", "night_right")}
    (tmp_path / "fetched").mkdir()
    with zipfile.ZipFile(tmp_path / "fetched" / "GardensPoint_Walking.zip", "w") as archive:
        for path in sorted(data_set.root.rglob("*.jpg"), reverse=True):
            archive.write(path, f"GardensPoint_Walking/{path.relative_to(data_set.root)}")
        archive.writestr("__MACOSX/GardensPoint_Walking/day_left/._Image000.jpg", b"x")
    for source in (tmp_path / "fetched", tmp_path / "fetched" / "GardensPoint_Walking.zip"):
        read = {one.name: list(one.frames) for one in gardens_point.read(source, gardens_point.Options()).traverses}
        assert list(read) == ["day_left", "night_right"]
        for name, frames in read.items():
            assert {frame.stem: frame.content.data for frame in frames if isinstance(frame.content, Encoded)} == dict(
                zip(("000", "010"), expected[name], strict=True)
            )
    shutil.copytree(data_set.root, tmp_path / "fetched" / "unpacked")
    (tmp_path / "fetched" / "junk.zip").write_bytes(b"junk")
    route = gardens_point.read(tmp_path / "fetched", gardens_point.Options())
    assert any("Not read" in note and "Walking.zip" in note and "junk.zip" in note for note in route.notes)
    frames = [frame for one in route.traverses for frame in one.frames]
    assert [isinstance(frame.content, Path) for frame in frames] == [True] * 4
    data = (tmp_path / "fetched" / "GardensPoint_Walking.zip").read_bytes()
    (tmp_path / "cut.zip").write_bytes(data[: len(data) // 2])
    with pytest.raises(RouteError, match=r"cut\.zip is"):
        gardens_point.read(tmp_path / "cut.zip", gardens_point.Options())


def test_other_capitals_separators_and_numbers(data_set: Any) -> None:
    data_set.images("GardensPoint/Day Left", ["image_0.png", "image_12.png"])
    data_set.images("GardensPoint/Night-Right", ["0000.jpg", "0012.jpg", "0013.jpg"])
    route = data_set.read(gardens_point, tolerance=0, condition="light")
    assert route.tolerance == 0
    assert "The copy has no day_right." in route.notes
    assert "Frames that not every traverse has: 1 of night_right." in route.notes
    read = {one.name: (one.condition, [frame.stem for frame in one.frames]) for one in route.traverses}
    assert read == {"day_left": ("day", ["000", "012"]), "night_right": ("night", ["000", "012", "013"])}


@pytest.mark.parametrize(
    ("folder", "names", "message"),
    [
        ("autumn", ["1.jpg"], "holds none of day_left, day_right, night_right"),
        ("day_left", ["cover.jpg"], r"day_left/cover\.jpg does not hold one number"),
        ("day_left", ["1_2.jpg"], "does not hold one number"),
        ("day_left", ["1.jpg", "001.jpg"], "both of place 001"),
        ("copy/day_left", [], "day_left and .*DayLeft are both day_left"),
    ],
)
def test_what_cannot_be_told(data_set: Any, folder: str, names: list[str], message: str) -> None:
    data_set.images(folder, names)
    if not names:
        data_set.images(folder, ["1.jpg"])
        data_set.images("other/DayLeft", ["1.jpg"])
    with pytest.raises(RouteError, match=message):
        data_set.read(gardens_point)


def test_the_real_set(shared_data: Path, tmp_path: Path) -> None:
    summary = import_route("gardens_point", shared_data / "gardens_point", tmp_path / "route")
    assert summary.traverses == {"day_left": 140, "day_right": 140, "night_right": 140}
    assert len(open_route(tmp_path / "route").shared_stems()) == 140
