"""A drive is a directory, a video or a bag."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.importing.sources.test_bag import FIX, IMAGE, POSE, Row, write_bag
from tests.mapping.drives import images_of, write_video

from everplace.errors import EverplaceError, RouteError
from everplace.images.decoding import ImageSpec
from everplace.importing.frame_pixels import decode_content
from everplace.mapping.drive_source import DriveFrames, open_drive
from everplace.route.folder import open_traverse


def test_a_directory_gives_its_images_by_their_stems(unchanged_rendered_route: Path) -> None:
    drive = open_drive(unchanged_rendered_route / "summer")
    frames = list(drive.frames)
    assert (drive.name, drive.count, len(frames)) == ("summer", 60, 60)
    assert [frame.stem for frame in frames[:2]] == ["00000", "00001"]


def test_a_traverse_is_a_drive(unchanged_rendered_route: Path) -> None:
    drive = open_drive(open_traverse(unchanged_rendered_route / "summer")[5:7])
    assert [frame.stem for frame in drive.frames] == ["00005", "00006"]


def test_poses_beside_the_images_are_read(tiny_route: Path) -> None:
    rows = "".join(f"{n},{n},1,0\n" for n in range(12))
    (tiny_route / "summer" / "poses.csv").write_text(f"stem,x,y,heading\n{rows}")
    poses = [frame.pose for frame in open_drive(tiny_route / "summer").frames]
    assert poses[3] == (3.0, 1.0, 0.0)


def test_a_video_gives_its_frames_by_their_numbers(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    images = images_of(unchanged_rendered_route / "summer")[:7]
    drive = open_drive(write_video(tmp_path / "way.to work.mp4", images))
    frames = list(drive.frames)
    assert drive.name == "way.to work"
    assert [int(frame.stem) for frame in frames] == list(range(7))
    assert [frame.seconds for frame in frames] == pytest.approx(np.arange(7) / 10)
    pixels = decode_content(frames[3], ImageSpec())
    assert np.abs(pixels.astype(int) - images[3]).mean() < 8


@pytest.mark.parametrize("name", ["drive.bag", "drive", "mcap-drive"])
def test_a_bag_gives_its_images(tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    images = np.random.default_rng(0).integers(0, 256, (3, 4, 6, 3), dtype=np.uint8)
    path = write_bag(tmp_path / name, [("/camera", IMAGE, 5.0 + n, ("rgb8", image)) for n, image in enumerate(images)])
    drive = open_drive(path)
    frames = list(drive.frames)
    assert drive.name == name.removesuffix(".bag")
    assert [int(frame.stem) for frame in frames] == [0, 1, 2]
    assert np.diff([frame.seconds or 0.0 for frame in frames]).tolist() == [1, 1]
    np.testing.assert_array_equal(decode_content(frames[2], ImageSpec()), images[2])


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("missing", "missing"),
        ("missing.mp4", "missing.mp4"),
        ("text.txt", "is no directory of images, no video .* and no bag"),
        ("picture.png", "is no directory of images"),
        ("empty", "empty"),
        ("broken.mp4", "broken.mp4"),
        ("broken.bag", "broken.bag"),
    ],
)
def test_what_is_no_drive_is_told_by_its_name(tiny_route: Path, tmp_path: Path, what: str, message: str) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("text.txt", "broken.mp4", "broken.bag"):
        (tmp_path / name).write_text("no frames\n")
    shutil.copy(tiny_route / "summer" / "0.png", tmp_path / "picture.png")
    with pytest.raises(EverplaceError, match=message) as caught:
        list(open_drive(tmp_path / what).frames)
    assert caught.value.exit_status == 2
    assert len(str(caught.value).splitlines()) == 1


def test_a_route_is_not_taken_for_a_drive(tiny_route: Path) -> None:
    with pytest.raises(RouteError):
        open_drive(tiny_route)


def test_what_a_recording_has_to_tell_is_told(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    dim = np.random.default_rng(0).integers(8000, 8900, (3, 4, 6, 1), dtype=np.uint16)
    path = write_bag(tmp_path / "dim.bag", [("/camera", IMAGE, 5.0 + n, ("mono16", one)) for n, one in enumerate(dim)])
    with pytest.warns(UserWarning, match="range=8"):
        assert len([decode_content(frame, ImageSpec()) for frame in open_drive(path).frames]) == 3


METRE = 1 / 111_194.9  # degrees of latitude


def recorded(path: Path, count: int = 6, *, fixes: Sequence[tuple[str, float, int]] = (), first: float = 48.0) -> Path:
    """A bag of images at 5, 6, ... s, with fixes (topic, seconds, status) every metre to the north."""
    images = np.random.default_rng(0).integers(0, 256, (count, 4, 6, 3), dtype=np.uint8)
    rows: list[Row] = [("/camera", IMAGE, 5.0 + number, ("rgb8", image)) for number, image in enumerate(images)]
    rows += [(topic, FIX, seconds, (status, first + (seconds - 5) * METRE, 11.0)) for topic, seconds, status in fixes]
    return write_bag(path, rows)


def ys(drive: DriveFrames) -> list[float | None]:
    return [None if frame.pose is None else frame.pose.y for frame in drive.frames]


@pytest.mark.parametrize("name", ["drive.bag", "drive", "mcap-drive"])
def test_satellite_fixes_of_a_bag_become_poses_where_they_are_wanted(tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    path = recorded(tmp_path / name, fixes=[("/gps", 5.0 + number, 0) for number in range(6)])
    assert ys(open_drive(path)) == [None] * 6
    drive = open_drive(path, fixes=True)
    assert drive.origin == (48.0, 11.0)
    assert ys(drive) == pytest.approx(np.arange(6), abs=0.01)
    elsewhere = open_drive(path, fixes=True, origin=(48.0 - 100 * METRE, 11.0))
    assert ys(elsewhere) == pytest.approx(np.arange(100, 106), abs=0.3)


def test_frames_without_a_fix_stay_without_a_pose(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    status = [0, 0, -1, -1, 0, 0]
    path = recorded(tmp_path / "gap.bag", fixes=[("/gps", 5.0 + number, one) for number, one in enumerate(status)])
    assert [y is None for y in ys(open_drive(path, fixes=True))] == [False, False, True, True, False, False]
    short = recorded(tmp_path / "short.bag", fixes=[("/gps", 5.0, 0), ("/gps", 6.0, 0)])
    assert [y is None for y in ys(open_drive(short, fixes=True))] == [False, False, True, True, True, True]


def test_poses_that_are_of_no_place_on_earth_are_left_out(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    images = np.random.default_rng(0).integers(0, 256, (3, 4, 6, 3), dtype=np.uint8)
    rows: list[Row] = [("/camera", IMAGE, 5.0 + number, ("rgb8", image)) for number, image in enumerate(images)]
    rows += [("/odometry", POSE, 5.0 + number, (1.0 * number, 0.0, (0.0, 0.0, 0.0, 1.0))) for number in range(3)]
    drive = open_drive(write_bag(tmp_path / "odometry.bag", rows), fixes=True)
    assert (ys(drive), drive.origin) == ([None] * 3, ())
    never = recorded(tmp_path / "never.bag", fixes=[("/gps", 5.0 + number, -1) for number in range(6)])
    drive = open_drive(never, fixes=True)
    assert (ys(drive), drive.origin) == ([None] * 6, ())


def test_fixes_that_cannot_be_taken_are_said(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="needs the extra ros")
    two = recorded(tmp_path / "two.bag", fixes=[(topic, 5.0 + n, 0) for topic in ("/left", "/right") for n in range(3)])
    with pytest.warns(UserWarning, match=r"several topics of satellite fixes \(/left, /right\); none was taken"):
        assert ys(open_drive(two, fixes=True)) == [None] * 6
    timeless = recorded(tmp_path / "timeless.bag", fixes=[("/gps", 0.0, 0)])
    with pytest.warns(UserWarning, match=r"the drive gets no poses: .* has no time stamp"):
        assert ys(open_drive(timeless, fixes=True)) == [None] * 6
