from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from everplace.errors import StorageError
from everplace.route.inspection import Inspection, Stretch, inspect_route
from everplace.route.route import open_route
from everplace.route.selection import Selection, select


def inspect(route: Path) -> Inspection:
    return inspect_route(open_route(route))


def black(path: Path) -> None:
    Image.new("RGB", (64, 32), (3, 3, 3)).save(path)


def test_a_sound_route(tiny_route: Path) -> None:
    found = inspect(tiny_route)
    assert found.places == found.kept == tuple(str(place) for place in range(12))
    assert (found.tunnels, found.stops, found.duplicates) == ((), (), ())
    assert [traverse.traverse.name for traverse in found.traverses] == ["summer", "winter"]
    for traverse in found.traverses:
        assert traverse.sizes == {(32, 64): 12}
        assert traverse.bytes == sum(path.stat().st_size for path in traverse.traverse.paths)
        assert traverse.unreadable == {}
        assert (traverse.gaps, traverse.missing) == ((), ())
        assert not np.any([traverse.dark, traverse.stationary, traverse.alike])


def test_every_unreadable_file_is_named_and_no_index_shifts(tiny_route: Path) -> None:
    winter = tiny_route / "winter"
    (winter / "2.png").write_bytes(b"")
    (winter / "5.png").write_bytes((winter / "5.png").read_bytes()[:60])
    (winter / "6.png").write_text("no image")
    (winter / "7.png").unlink()
    (winter / "7.png").symlink_to(winter / "gone")
    black(winter / "8.png")
    found = inspect(tiny_route)
    summer, cold = found.traverses
    assert list(cold.unreadable) == ["2", "5", "6", "7"]
    for stem, why in zip("2567", ("0 bytes", "truncated or broken", "known format", "cannot read"), strict=True):
        assert f"winter/{stem}.png" in cold.unreadable[stem]
        assert why in cold.unreadable[stem]
    assert summer.unreadable == {}
    assert sum(cold.sizes.values()) == 8
    assert np.flatnonzero(found.broken).tolist() == [2, 5, 6, 7]
    assert np.flatnonzero(found.dark).tolist() == [8]
    assert np.flatnonzero(cold.dark).tolist() == [8]
    assert found.duplicates == ()
    assert found.kept == ("0", "1", "3", "4", "9", "10", "11")


def test_tunnels_and_stops(tiny_route: Path) -> None:
    for name in ("summer", "winter"):
        for place in (5, 6):
            shutil.copy(tiny_route / name / "4.png", tiny_route / name / f"{place}.png")
    shutil.copy(tiny_route / "summer" / "8.png", tiny_route / "summer" / "9.png")
    for place in (0, 1, 11):
        black(tiny_route / "winter" / f"{place}.png")
    found = inspect(tiny_route)
    assert found.tunnels == (Stretch("0", "1", 2), Stretch("11", "11", 1))
    assert found.stops == (Stretch("5", "6", 2),)
    summer, winter = found.traverses
    assert np.flatnonzero(summer.stationary).tolist() == [5, 6, 9]
    assert np.flatnonzero(winter.stationary).tolist() == [5, 6]
    assert found.duplicates == (
        ("summer/4", "summer/5", "summer/6"),
        ("summer/8", "summer/9"),
        ("winter/0", "winter/1", "winter/11"),
        ("winter/4", "winter/5", "winter/6"),
    )


def test_one_file_under_two_conditions_is_a_duplicate(tiny_route: Path) -> None:
    shutil.copy(tiny_route / "summer" / "3.png", tiny_route / "winter" / "3.png")
    assert inspect(tiny_route).duplicates == (("summer/3", "winter/3"),)


def test_almost_the_same_picture_in_another_file(tiny_route: Path) -> None:
    summer = tiny_route / "summer"
    picture = np.asarray(Image.open(summer / "4.png"))
    Image.fromarray(picture ^ 1).save(summer / "5.png")
    Image.fromarray(np.clip(picture.astype(int) + 12, 0, 255).astype(np.uint8)).save(summer / "6.png")
    shutil.copy(summer / "6.png", summer / "7.png")
    assert np.flatnonzero(inspect(tiny_route).traverses[0].alike).tolist() == [5]


def test_frames_that_one_traverse_lacks(tiny_route: Path) -> None:
    (tiny_route / "winter" / "0.png").unlink()
    (tiny_route / "winter" / "7.png").unlink()
    (tiny_route / "summer" / "11.png").unlink()
    black(tiny_route / "summer" / "2.png")
    found = inspect(tiny_route)
    assert [traverse.missing for traverse in found.traverses] == [("11",), ("0", "7")]
    assert [[gap.missing for gap in traverse.gaps or ()] for traverse in found.traverses] == [[], [1]]
    assert found.places == ("1", "2", "3", "4", "5", "6", "8", "9", "10")
    assert found.tunnels == (Stretch("2", "2", 1),)


def test_traverses_that_are_not_aligned(tiny_route: Path) -> None:
    (tiny_route / "route.toml").write_text("aligned = false\n")
    black(tiny_route / "winter" / "0.png")
    found = inspect(tiny_route)
    assert (found.places, found.kept, found.tunnels) == ((), (), ())
    assert found.traverses[1].dark[0]


def test_no_name_is_missing_where_names_are_no_places(tiny_route: Path) -> None:
    (tiny_route / "winter" / "3.png").unlink()
    assert [traverse.missing for traverse in inspect(tiny_route).traverses] == [(), ("3",)]
    (tiny_route / "route.toml").write_text("aligned = false\n")
    found = inspect(tiny_route)
    assert [traverse.missing for traverse in found.traverses] == [(), ()]
    assert found.places == ()


def test_pictures_of_several_sizes(tiny_route: Path) -> None:
    Image.new("RGB", (100, 50), (90, 80, 70)).save(tiny_route / "summer" / "3.png")
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.new("RGB", (100, 50), (90, 80, 70)).save(tiny_route / "summer" / "4.png", exif=exif)
    assert inspect(tiny_route).traverses[0].sizes == {(32, 64): 10, (50, 100): 1, (100, 50): 1}


@pytest.mark.parametrize("count", [513, 1025])
def test_blocks_leave_no_seams(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(4)
    (tmp_path / "route" / "a").mkdir(parents=True)
    pictures = rng.integers(30, 220, (count, 4, 8), dtype=np.uint8)
    pictures[512::512] = pictures[511:-1:512] ^ 1
    for index, picture in enumerate(pictures):
        Image.fromarray(picture).save(tmp_path / "route" / "a" / f"{index}.pgm")
    found = inspect(tmp_path / "route")
    assert np.flatnonzero(found.traverses[0].alike).tolist() == [index for index in (512, 1024) if index < count]
    assert [stop.first for stop in found.stops] == [str(index) for index in (512, 1024) if index < count]


def test_nothing_is_left_in_the_cache(tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    inspect(tiny_route)
    assert [path for path in (tmp_path / "cache").rglob("*") if path.is_file()] == []
    (tmp_path / "file").touch()
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "file"))
    with pytest.raises(StorageError, match="EVERPLACE_CACHE"):
        inspect(tiny_route)


@pytest.mark.slow
def test_nordland_has_its_tunnels_and_stops(shared_data: Path) -> None:
    route = open_route(shared_data / "nordland64")
    found = inspect_route(route)
    both = select(route, Selection(drop_dark=True, drop_stationary=True))
    assert (len(found.places), int(found.dark.sum()), int(found.stationary.sum())) == (2384, 130, 252)
    assert found.kept == both.traverses[0].stems
    assert sum(stretch.places for stretch in found.tunnels + found.stops) == 382
    assert Stretch("images-00010", "images-00170", 17) in found.tunnels
    assert max(found.stops, key=lambda stop: stop.places) == Stretch("images-01300", "images-01700", 41)
    assert not found.broken.any()


def test_gardens_point_is_sound(shared_data: Path) -> None:
    found = inspect_route(open_route(shared_data / "gardens_point"))
    assert len(found.kept) == len(found.places) == 140
    assert [traverse.sizes for traverse in found.traverses] == [{(540, 960): 140}, {(540, 960): 140}, {(360, 640): 140}]
    assert found.duplicates == ()
