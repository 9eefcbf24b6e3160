from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.positions.geodesy import local_plane
from everplace.importing.positions.gps import poses_on_track, read_gps

HERE = (36.366, 127.365)


def write(directory: Path, text: str) -> Path:
    path = directory / "gps.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_times_are_interpolated_except_in_gaps_and_outside(tmp_path: Path) -> None:
    path = write(tmp_path, "speed,Time,x,y\n1,10,0,0\n1,11,10,0\n1,15,50,0\n1,16,50,10\n")
    times = np.array([9.9, 10.0, 10.5, 11.0, 13.0, 15.0, 15.5, 16.0, 16.1])
    poses = poses_on_track(read_gps(path), [""] * 9, times, HERE)
    known = np.isfinite(poses[:, 0])
    assert known.tolist() == [False, True, True, True, False, True, True, True, False]
    np.testing.assert_allclose(poses[known, :2], [[0, 0], [5, 0], [10, 0], [50, 0], [50, 5], [50, 10]])
    np.testing.assert_allclose(poses[known, 2], [0, 0, 0, np.pi / 2, np.pi / 2, np.pi / 2])


def test_frames_are_found_by_name_and_degrees_become_metres(tmp_path: Path) -> None:
    path = write(tmp_path, f"\ufefflon,lat,stem\n{HERE[1] + 0.001},{HERE[0]},b\n{HERE[1]},{HERE[0]},a\n")
    track = read_gps(path)
    assert (track.degrees, track.seconds) == (True, None)
    poses = poses_on_track(track, ["a", "b", "c"], None, HERE)
    expected = local_plane(np.array([[HERE[0], HERE[1] + 0.001]]), HERE)[0]
    np.testing.assert_allclose(poses[1, :2], expected)
    np.testing.assert_allclose(poses[:2, 2], 0.0, atol=1e-9)
    assert np.isnan(poses[2]).all()


def test_one_fix_covers_its_own_moment(tmp_path: Path) -> None:
    track = read_gps(write(tmp_path, "seconds,x,y\n5,1,2\n"))
    poses = poses_on_track(track, ["a", "b"], np.array([5.0, 5.1]), HERE)
    assert poses[0].tolist() == [1.0, 2.0, 0.0]
    assert np.isnan(poses[1]).all()


def test_times_for_frames_without_times(tmp_path: Path) -> None:
    track = read_gps(write(tmp_path, "seconds,x,y\n5,1,2\n"))
    with pytest.raises(RouteError, match="has times, but the frames have none; give it a column `stem`"):
        poses_on_track(track, ["a"], None, HERE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must name stem or seconds, and latitude and longitude or x and y"),
        ("stem,lat,x\na,1,2\n", "must name stem or seconds"),
        ("lat,lon\n1,2\n", "must name stem or seconds"),
        ("stem,x,y\n", "holds no position"),
        ("stem,x,y\na,1\n", "row 2 has 2 cells, but the first line names 3 columns"),
        ("stem,x,y\na,1,5,2\n", "row 2 has 4 cells, but the first line names 3 columns"),
        ("stem,x,y\na,1,north\n", "row 2 must hold frame and two numbers"),
        ("seconds,x,y\nnoon,1,2\n", "row 2 must hold seconds and two numbers"),
        ("stem,x,y\na,nan,2\n", "row 2 holds a number that is not finite"),
        ("stem,lat,lon\na,127.3,36.3\n", "row 2 holds 127.3, 36.3, no latitude and longitude; are the columns swapped"),
        ("seconds,x,y\n1,0,0\n1,0,0\n", "row 3 goes back in time"),
        ("stem,x,y\na,0,0\na,0,0\n", "names a frame twice"),
        ('stem,x,y\n"a,0,0\n', "not a UTF-8 CSV file"),
    ],
)
def test_mistakes_name_file_and_row(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(RouteError, match=message) as caught:
        read_gps(path)
    assert str(path) in str(caught.value)


@given(
    st.text(alphabet='012.-e,\n"\r\0nasecodxytlim', max_size=50).map(lambda rest: "seconds,x,y\n" + rest) | st.text()
)
@fuzzed(60)
def test_fuzzed_text_gives_a_track_or_one_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "gps.csv"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            track = read_gps(path)
            poses = poses_on_track(track, ["a"], np.array([1.0]), HERE)
            assert poses.shape == (1, 3)
        except RouteError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize(
    "text",
    [
        "stem,lat,lon\na,0,0\nb,48.0,11.0\nc,0.0,-0.0\nd,48.0,11.0001\n",
        "longitude,latitude,frame\n0,0,a\n11.0,48.0,b\n0,0,c\n11.0001,48.0,d\n",
        "image,lat,lng,fix\na,0.000000,0.000000,1\nb,48.0,11.0,1\nc,0e0,0,1\nd,48.0,11.0001,1\n",
    ],
)
def test_exactly_0_0_degrees_is_no_fix(tmp_path: Path, text: str) -> None:
    track = read_gps(write(tmp_path, text))
    assert (track.frames, track.lost) == (("b", "d"), 2)
    poses = poses_on_track(track, ["a", "b", "c", "d"], None, (48.0, 11.0))
    assert np.isfinite(poses[:, 0]).tolist() == [False, True, False, True]
    np.testing.assert_allclose(poses[3, :2] - poses[1, :2], [7.46, 0], atol=0.01)


def test_fixes_by_time_around_one_that_is_none(tmp_path: Path) -> None:
    track = read_gps(write(tmp_path, "time,lat,lon\n0,0,0\n1,48.0,11.0\n2,0,0\n3,48.0,11.0002\n"))
    poses = poses_on_track(track, [""] * 5, np.array([0.0, 0.5, 1.0, 2.0, 3.0]), (48.0, 11.0))
    np.testing.assert_allclose(poses[:, 0], [np.nan, np.nan, 0, 7.46, 14.92], atol=0.01)


def test_on_the_equator_and_in_metres_0_is_a_position(tmp_path: Path) -> None:
    assert read_gps(write(tmp_path, "stem,lat,lon\na,0,9\nb,9,0\n")).lost == 0
    assert read_gps(write(tmp_path, "stem,x,y\na,0,0\nb,1,0\n")).frames == ("a", "b")


@pytest.mark.parametrize("seconds", [None, np.array([0.0, 1.0])])
def test_a_file_without_a_fix_covers_nothing(tmp_path: Path, seconds: NDArray[np.float64] | None) -> None:
    column = "stem" if seconds is None else "time"
    track = read_gps(write(tmp_path, f"{column},lat,lon\n0,0,0\n1,0,0\n"))
    assert np.isnan(poses_on_track(track, ["0", "1"], seconds, HERE)).all()
