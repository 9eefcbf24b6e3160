"""EuRoC MAV sequences."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.sources import euroc

START = 1403636579763555584
# The body's x axis points up and z ahead; the camera's z ahead, y down; it is 0.5 m ahead of the body.
SENSOR = """# camera
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.0,
         1.0, 0.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.5,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
"""
UPRIGHT = Rotation.from_matrix([[0, 0, 1], [0, -1, 0], [1, 0, 0]])  # looks along the world's x axis


def write(data_set: Any, sequence: str = "MH_01", frames: int = 4) -> None:
    stamps = [START + index * 50_000_000 for index in range(frames)]
    root = f"{sequence}/mav0"
    data_set.images(f"{root}/cam0/data", [f"{stamp}.png" for stamp in stamps])
    data_set.text(f"{root}/cam0/data.csv", ["#timestamp [ns],filename", *(f"{stamp},{stamp}.png" for stamp in stamps)])
    data_set.text(f"{root}/cam0/sensor.yaml", SENSOR.splitlines())
    lines = ["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"]
    for index in range(0, 26):
        x, y, z, w = (Rotation.from_euler("z", index, degrees=True) * UPRIGHT).as_quat()
        lines.append(
            f"{START + index * 5_000_000},{index},{-index},9,{w:.9f},{x:.9f},{y:.9f},{z:.9f},0,0,0,0,0,0,0,0,0"
        )
    data_set.text(f"{root}/state_groundtruth_estimate0/data.csv", lines)


@pytest.mark.parametrize("where", [".", "MH_01", "MH_01/mav0"])
def test_the_cameras_pose_in_the_world(data_set: Any, where: str) -> None:
    write(data_set)
    ((name, frames),) = data_set.frames(euroc, where).items()
    assert name == "MH_01"
    assert [frame.stem for frame in frames] == [str(START + index * 50_000_000) for index in range(3)]
    for index, frame in enumerate(frames):
        turned = math.radians(10 * index)
        expected = (10 * index + 0.5 * math.cos(turned), -10 * index + 0.5 * math.sin(turned), turned)
        assert frame.pose == pytest.approx(expected, abs=1e-6)
    assert frames[1].seconds - frames[0].seconds == pytest.approx(0.05, abs=1e-6)
    assert "1 of 4 frames of MH_01 have no pose within 0.02 s" in data_set.read(euroc).notes[0]


def test_sequences_are_imported(data_set: Any) -> None:
    write(data_set)
    write(data_set, "V1_02", frames=2)
    route = data_set.imported("euroc", radius="2")
    assert {traverse.name: len(traverse) for traverse in route.traverses} == {"MH_01": 3, "V1_02": 2}
    assert route.radius == 2.0


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("cam0/sensor.yaml", "T_BS: none\n", r"sensor\.yaml holds no T_BS with 16 numbers"),
        ("cam0/sensor.yaml", SENSOR.replace("0.5", "near"), "holds no T_BS"),
        ("cam0/data.csv", "now,1.png\n", r"cam0/data\.csv, line 1 holds 'now' where a time stamp must be"),
        ("cam0/data.csv", "#t\n", "names no image"),
        ("cam0/data.csv", f"{START}\n", "has 1 fields, but must have 2"),
        ("state_groundtruth_estimate0/data.csv", f"{START},1,2,3,0,0,0,0\n", "whose length is not 1"),
        ("state_groundtruth_estimate0/data.csv", "#t\n", "holds no pose"),
    ],
)
def test_mistakes_name_the_file(data_set: Any, file: str, content: str, message: str) -> None:
    write(data_set)
    (data_set.root / "MH_01/mav0" / file).write_text(content)
    with pytest.raises(RouteError, match=message):
        data_set.read(euroc)


def test_without_the_cameras_mounting(data_set: Any) -> None:
    write(data_set)
    (data_set.root / "MH_01/mav0/cam0/sensor.yaml").unlink()
    with pytest.raises(RouteError, match=r"sensor\.yaml, which says how the camera is mounted"):
        data_set.read(euroc)
    assert len(data_set.frames(euroc, poses=False)["MH_01"]) == 4


@given(st.text(st.sampled_from("0123456789.-e, \n"), max_size=60), st.text(st.sampled_from("T_BS:data[]0123,. \n")))
@fuzzed(60)
def test_any_text_is_a_sequence_or_one_error(data_set: Any, rows: str, sensor: str) -> None:
    write(data_set, frames=1)
    truth = data_set.root / "MH_01/mav0/state_groundtruth_estimate0/data.csv"
    truth.write_text(truth.read_text() + rows)
    (data_set.root / "MH_01/mav0/cam0/sensor.yaml").write_text(SENSOR if rows else sensor)
    try:
        assert data_set.frames(euroc)["MH_01"]
    except RouteError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("text", ["T_BS:\n" + "\n" * 2**19, "T_BS:\n" * 2**17, "T_BS:\n" + "data:[\n" * 2**17])
def test_a_damaged_sensor_file_is_read_through_once(data_set: Any, text: str) -> None:
    write(data_set, frames=1)
    (data_set.root / "MH_01/mav0/cam0/sensor.yaml").write_text(text)
    started = time.monotonic()
    with pytest.raises(RouteError, match="holds no T_BS with 16 numbers"):
        data_set.frames(euroc)
    assert time.monotonic() - started < 5
