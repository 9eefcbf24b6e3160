from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.fuzzing import fuzzed
from tests.importing.packing import pack

from everplace.errors import ConfigError, EverplaceError, RouteError
from everplace.importing.import_route import import_route
from everplace.importing.positions.geodesy import local_plane
from everplace.importing.sources import ms2
from everplace.route.route import Route, open_route

HERE = (36.3661, 127.3656)
DAY, NIGHT, RAIN = "_2021-08-13-15-46-56", "_2021-08-13-21-18-04", "_2021-08-06-16-19-00"


def write_drive(root: Path, name: str, frames: int, *, swapped: bool = False, camera: str = "rgb") -> None:
    """One sequence as MS2 lays it out: stereo images, a time stamp file a camera, a position file a frame."""
    base = root / "sync_data" / name
    for side in ("left", "right"):
        images = base / camera / f"img_{side}"
        images.mkdir(parents=True)
        for number in range(frames):
            Image.new("RGB", (8, 4), (number, 0, 0)).save(images / f"{number:06d}.png")
        times = [f"{1628230000_000000000 + number * 100_000000}" for number in range(frames)]
        images.with_name(f"img_{side}_timestamp.txt").write_text("\n".join(times) + "\n")
    (base / "gps_imu" / "data").mkdir(parents=True, exist_ok=True)
    for number in range(frames):
        position = [HERE[0] + number * 1e-5, HERE[1]]
        values = [*(position[::-1] if swapped else position), 60.5, *[0.1] * 7]
        text = "".join(f"{value:.15f}\n" for value in values)
        (base / "gps_imu" / "data" / f"{number:06d}.txt").write_text(text)


def imported(source: Path, out: Path, **options: str) -> Route:
    shutil.rmtree(out, ignore_errors=True)
    import_route("ms2", source, out, options)
    return open_route(out)


@pytest.mark.parametrize("inside", ["", "sync_data"])
def test_drives_become_traverses_with_conditions_poses_and_times(tmp_path: Path, inside: str) -> None:
    for name in (DAY, NIGHT, RAIN):
        write_drive(tmp_path / "ms2", name, 3, swapped=name == NIGHT)
    route = imported(tmp_path / "ms2" / inside, tmp_path / "route")
    assert {traverse.name: traverse.condition for traverse in route.traverses} == {
        "2021-08-06-16-19-00": "rain", "2021-08-13-15-46-56": "day", "2021-08-13-21-18-04": "night",
    }  # fmt: skip
    assert not route.aligned
    assert route.truth_origin == "positions by GPS"
    night = route["night"]
    assert night.stems[1] == "2021-08-13-21-18-04_000001"
    assert night.paths[1].resolve() == (tmp_path / "ms2/sync_data" / NIGHT / "rgb/img_left/000001.png").resolve()
    expected = local_plane(np.array([(HERE[0] + number * 1e-5, HERE[1]) for number in range(3)]), HERE)
    for traverse in route.traverses:
        assert traverse.poses is not None
        np.testing.assert_allclose(traverse.poses[:, :2], expected, atol=1e-6)
        np.testing.assert_allclose(traverse.poses[:, 2], np.pi / 2, atol=1e-9)
    lines = (tmp_path / "route/2021-08-13-21-18-04/times.csv").read_text().splitlines()
    assert lines[2] == "2021-08-13-21-18-04_000001,1628230000.1"


@pytest.mark.parametrize("archived", [False, True])
def test_a_complete_copy_holds_projected_depth_beside_the_drives(tmp_path: Path, archived: bool) -> None:
    write_drive(tmp_path / "ms2", DAY, 2)
    depth = tmp_path / "ms2/proj_depth" / DAY / "rgb/depth"
    shutil.copytree(tmp_path / "ms2/sync_data" / DAY / "rgb/img_left", depth)
    source = pack(tmp_path / "ms2", tmp_path / "ms2.zip") if archived else tmp_path / "ms2"
    assert len(imported(source, tmp_path / "route").traverses[0]) == 2
    shutil.copytree(depth, depth.with_name("img_left"))
    source = pack(tmp_path / "ms2", tmp_path / "ms2.zip") if archived else tmp_path / "ms2"
    assert len(imported(source, tmp_path / "second").traverses[0]) == 2


def test_camera_side_sequences_conditions_and_every(tmp_path: Path) -> None:
    write_drive(tmp_path, DAY, 5)
    write_drive(tmp_path, NIGHT, 2)
    write_drive(tmp_path, "indoor", 2)
    route = imported(
        tmp_path, tmp_path / "route", side="right", every="2", sequences=f"{DAY},indoor", conditions=f"{DAY}:noon"
    )
    assert [(traverse.condition, len(traverse)) for traverse in route.traverses] == [("noon", 3), ("indoor", 1)]
    assert "img_right" in str(route["noon"].paths[2].resolve())
    assert route["noon"].stems[2].endswith("_000004")
    with pytest.raises(RouteError, match="holds no sync_data/<sequence>/thr"):
        imported(tmp_path, tmp_path / "route", camera="thr")
    with pytest.raises(ConfigError, match="sequences='x' is not there; there are: _2021"):
        imported(tmp_path, tmp_path / "route", sequences="x")


def test_without_positions_and_times_there_are_none(tmp_path: Path) -> None:
    write_drive(tmp_path, DAY, 2)
    shutil.rmtree(tmp_path / "sync_data" / DAY / "gps_imu")
    (tmp_path / "sync_data" / DAY / "rgb/img_left_timestamp.txt").unlink()
    summary = import_route("ms2", tmp_path, tmp_path / "route")
    assert open_route(tmp_path / "route").traverses[0].poses is None
    assert f"{DAY} has no gps_imu/data: it gets no poses." in summary.notes
    assert not (tmp_path / "route" / DAY.lstrip("_") / "times.csv").exists()


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("gps_imu/data/000001.txt", None, "000001.txt does not exist, but an image of .*img_left names it"),
        ("gps_imu/data/000001.txt", "36.1\n", "000001.txt must begin with two lines of one number each"),
        ("gps_imu/data/000001.txt", "north\n127\n", "must begin with two lines of one number each"),
        ("gps_imu/data/000001.txt", "127.1\n127.2\n", "127.1, 127.2, which is no position on Earth"),
        ("gps_imu/data/000001.txt", "nan\n127.2\n", "nan, 127.2, which is no position on Earth"),
        ("gps_imu/data/000001.txt", "caf\u00e9\n", "must begin with two lines"),
        ("rgb/img_left_timestamp.txt", "1\n", "holds 1 times, but must hold 2"),
        ("rgb/img_left_timestamp.txt", "1\ninf\n", "holds 2 times, but must hold 2, one for each image, all finite"),
        ("rgb/img_left_timestamp.txt", "1\nlater\n", "must hold one number a line"),
    ],
)
def test_damaged_files_are_named(tmp_path: Path, file: str, text: str | None, message: str) -> None:
    write_drive(tmp_path, DAY, 2)
    path = tmp_path / "sync_data" / DAY / file
    path.unlink()
    if text is not None:
        path.write_text(text)
    with pytest.raises(RouteError, match=message):
        imported(tmp_path, tmp_path / "route")
    assert not (tmp_path / "route").exists()


def test_a_sequence_without_images(tmp_path: Path) -> None:
    (tmp_path / "sync_data" / DAY / "rgb" / "img_left").mkdir(parents=True)
    with pytest.raises(RouteError, match="img_left holds no image; unpack it"):
        imported(tmp_path, tmp_path / "route")


@pytest.mark.parametrize("unit", [1, 1e3, 1e6, 1e9])
def test_times_may_have_any_unit(tmp_path: Path, unit: float) -> None:
    write_drive(tmp_path, DAY, 2)
    path = tmp_path / "sync_data" / DAY / "rgb/img_left_timestamp.txt"
    path.write_text(f"{1628230000 * unit:.0f}\n{1628230002 * unit:.0f}\n")
    imported(tmp_path, tmp_path / "route")
    lines = (tmp_path / "route" / DAY.lstrip("_") / "times.csv").read_text().splitlines()
    assert [line.partition(",")[2] for line in lines[1:]] == ["1628230000.0", "1628230002.0"]


@fuzzed(60)
@given(
    text=st.binary(max_size=30) | st.text(st.sampled_from("0123456789.-e \n"), max_size=30).map(str.encode),
    times=st.booleans(),
)
def test_any_text_is_a_sequence_or_one_error(tmp_path: Path, text: bytes, times: bool) -> None:
    base = tmp_path / "ms2" / "sync_data" / DAY
    if not base.exists():
        write_drive(tmp_path / "ms2", DAY, 1)
    file = base / ("rgb/img_left_timestamp.txt" if times else "gps_imu/data/000000.txt")
    before = file.read_bytes()
    file.write_bytes(text)
    try:
        ((frame,),) = (traverse.frames for traverse in ms2.read(tmp_path / "ms2", ms2.Options()).traverses)
        assert frame.pose is not None
        assert frame.seconds is not None
        assert np.isfinite([*frame.pose, frame.seconds]).all()
    except EverplaceError as error:
        assert file.name in str(error)
        assert len(str(error).splitlines()) == 1
    finally:
        file.write_bytes(before)


@pytest.mark.parametrize("archived", [False, True])
def test_thermal_frames_are_scaled_by_what_their_drive_uses(tmp_path: Path, archived: bool) -> None:
    for name, first in ((DAY, 3000), (NIGHT, 1500)):
        write_drive(tmp_path / "ms2", name, 3, camera="thr")
        for number in range(3):
            values = np.linspace(first, first + 999 + number, 64 * 32).astype(np.uint16).reshape(32, 64)
            path = tmp_path / "ms2/sync_data" / name / f"thr/img_left/{number:06d}.png"
            Image.fromarray(values).save(path)
    source = pack(tmp_path / "ms2", tmp_path / "ms2.zip") if archived else tmp_path / "ms2"
    summary = import_route("ms2", source, tmp_path / "route", {"camera": "thr"})
    assert len([note for note in summary.notes if "The 16-bit values" in note]) == 2
    for traverse in open_route(tmp_path / "route").traverses:
        for path in traverse.paths:
            pixels = np.asarray(Image.open(path))
            assert pixels.dtype == np.uint8
            assert len(np.unique(pixels)) > 200
            assert 100 < pixels.mean() < 150
    # One scale for both drives, and the upper halves as they were, where the user says so
    one = imported(source, tmp_path / "one", camera="thr", range="1500:4000")
    means = [np.asarray(Image.open(traverse.paths[0])).mean() for traverse in one.traverses]
    assert means[0] - means[1] == pytest.approx(1500 / 2500 * 256, abs=2)
    plain = import_route("ms2", source, tmp_path / "plain", {"camera": "thr", "bits": "16"})
    assert plain.linked == (0 if archived else 6)


@pytest.mark.parametrize(
    ("lost", "kept"), [([0], [1, 2, 3]), ([2], [0, 1, 3]), ([0, 1, 3], [2]), ([0, 1, 2, 3], [0, 1, 2, 3])]
)
def test_frames_at_exactly_0_0_are_left_out_unless_all_are(tmp_path: Path, lost: list[int], kept: list[int]) -> None:
    write_drive(tmp_path, DAY, 4)
    for number in lost:
        path = tmp_path / "sync_data" / DAY / f"gps_imu/data/{number:06d}.txt"
        path.write_text("0.000000\n-0.000000\n" + "".join(path.read_text().splitlines(keepends=True)[2:]))
    summary = import_route("ms2", tmp_path, tmp_path / "route")
    (traverse,) = open_route(tmp_path / "route").traverses
    assert [int(stem[-6:]) for stem in traverse.stems] == kept
    times = (traverse.root / "times.csv").read_text().splitlines()[1:]
    assert [row.partition(",")[2] for row in times] == [str(1628230000.0 + number / 10) for number in kept]
    if len(lost) < 4:
        assert traverse.poses is not None
        np.testing.assert_allclose(traverse.poses[:, 1], [(number - kept[0]) * 1.1097 for number in kept], atol=1e-3)
        told = (
            f"{len(lost)} of 4 frames of {DAY} are at exactly 0, 0, where the receiver had no fix, and were left out."
        )
    else:
        assert traverse.poses is None
        told = f"{DAY} holds no fix in gps_imu/data, 0, 0 throughout: it gets no poses."
    assert told in summary.notes


def test_ms2_that_is_thinned_counts_the_frames_that_take_part(tmp_path: Path) -> None:
    write_drive(tmp_path, DAY, 6)
    (tmp_path / "sync_data" / DAY / "gps_imu/data/000002.txt").write_text("0\n0\n")
    (tmp_path / "sync_data" / DAY / "gps_imu/data/000003.txt").write_text("0\n0\n")
    summary = import_route("ms2", tmp_path, tmp_path / "route", {"every": "2"})
    (traverse,) = open_route(tmp_path / "route").traverses
    assert [int(stem[-6:]) for stem in traverse.stems] == [0, 4]
    assert [note for note in summary.notes if note.startswith("1 of 3 frames")]
