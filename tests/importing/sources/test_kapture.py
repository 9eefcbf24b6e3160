"""kapture directories."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.sources import kapture

# Columns: where the axes of a level camera (right, down, ahead) point in a world with z up, looking along x.
LEVEL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def values(rotation: Rotation, shift: Any) -> str:
    x, y, z, w = rotation.as_quat()
    return ", ".join(f"{value:.12g}" for value in (w, x, y, z, *shift))


def world_to(centre: tuple[float, float, float], degrees: float) -> str:
    """What kapture stores of a camera at a place: the inverse of its pose."""
    inverse = (Rotation.from_euler("z", degrees, degrees=True) * LEVEL).inv()
    return values(inverse, -inverse.apply(centre))


def write(data_set: Any, where: str, records: list[str], trajectories: list[str] | None, rigs: list[str] = ()) -> None:  # type: ignore[assignment]
    images = [record.split(", ")[2] for record in records]
    data_set.images(f"{where}/sensors/records_data", images)
    head = "# kapture format: 1.1"
    cameras = [f"cam{index}, , camera, SIMPLE_PINHOLE, 640, 480, 500, 320, 240" for index in range(3)]
    data_set.text(f"{where}/sensors/sensors.txt", [head, *cameras, "gps, , gnss, EPSG:4326"])
    data_set.text(f"{where}/sensors/records_camera.txt", [head, "# timestamp, device_id, image_path", *records])
    if trajectories is not None:
        data_set.text(f"{where}/sensors/trajectories.txt", [head, *trajectories])
    if rigs:
        data_set.text(f"{where}/sensors/rigs.txt", [head, *rigs])


def test_the_centre_and_heading_of_a_camera(data_set: Any) -> None:
    records = [f"{index:04d}, cam0, day/cam_0/{index:05d}.jpg" for index in range(3)]
    poses = [f"{index}, cam0, {world_to((index, -2.0 * index, 7.0), 40.0 * index)}" for index in range(2)]
    write(data_set, ".", records, poses)
    ((name, frames),) = data_set.frames(kapture).items()
    assert name == "set"
    assert [frame.stem for frame in frames] == ["day-cam_0-00000", "day-cam_0-00001"]
    for index, frame in enumerate(frames):
        assert frame.pose == pytest.approx((index, -2.0 * index, math.radians(40.0 * index)), abs=1e-9)
    notes = data_set.read(kapture).notes
    assert notes[0].startswith("The axis z was taken for up")
    assert "1 of 3 frames of set have no pose in trajectories.txt" in notes[1]
    turned = data_set.frames(kapture, up="-y")["set"]
    assert turned[1].pose.x == pytest.approx(7.0)


def test_a_camera_on_a_rig(data_set: Any) -> None:
    mounted = Rotation.from_euler("xyz", [0.1, -0.2, 0.3])  # rig to camera
    shift = np.array([0.1, 0.2, 0.3])
    camera = (Rotation.from_euler("z", 50, degrees=True) * LEVEL).inv()  # world to camera
    camera_shift = -camera.apply([5.0, 6.0, 7.0])
    rig = mounted.inv() * camera
    rig_shift = mounted.inv().apply(camera_shift - shift)
    write(
        data_set,
        ".",
        ["7, cam1, a.jpg"],
        [f"7, rig, {values(rig, rig_shift)}"],
        ["rig, cam1, " + values(mounted, shift), "rig, gps, 1, 0, 0, 0, 0, 0, 0"],
    )
    (frame,) = data_set.frames(kapture)["set"]
    assert frame.pose == pytest.approx((5.0, 6.0, math.radians(50)), abs=1e-9)


def test_one_camera_of_several_is_chosen(data_set: Any) -> None:
    write(data_set, ".", ["0, cam0, a.jpg", "0, cam1, b.jpg", "1, cam0, c.jpg"], None)
    with pytest.raises(RouteError, match="images of the cameras cam0, cam1; choose one with `camera=ID`, or all"):
        data_set.read(kapture)
    assert [frame.stem for frame in data_set.frames(kapture, camera="cam0")["set"]] == ["a", "c"]
    assert len(data_set.frames(kapture, camera="all")["set"]) == 3
    with pytest.raises(RouteError, match="holds no image of the camera 'cam2', only of cam0, cam1"):
        data_set.read(kapture, camera="cam2")


def test_mapping_and_query_are_imported(data_set: Any) -> None:
    here = [f"{index}, cam0, {world_to((10.0 * index, 0.0, 0.0), 0.0)}" for index in range(3)]
    write(data_set, "mapping", [f"{index}, cam0, m{index}.jpg" for index in range(3)], here)
    write(data_set, "query", ["0, cam1, q0.jpg", "1, cam1, q1.jpg"], [line.replace("cam0", "cam1") for line in here])
    route = data_set.imported("kapture", radius="4")
    assert route.radius == 4.0
    assert route["query"].stems == ("q0", "q1")
    assert route["query"].poses is not None
    assert route["query"].poses[:, 0].tolist() == pytest.approx([0.0, 10.0])


def test_folders_become_traverses_and_queries_may_lack_poses(data_set: Any) -> None:
    poses = [f"0, cam0, {world_to((1.0, 2.0, 3.0), 0.0)}"]
    write(data_set, ".", ["0, cam0, mapping/1.jpg", "9, cam0, query/1.jpg"], poses)
    frames = data_set.frames(kapture, by_folder=True)
    assert {name: [frame.stem for frame in found] for name, found in frames.items()} == {
        "mapping": ["mapping-1"], "query": ["query-1"],
    }  # fmt: skip
    assert frames["query"][0].pose is None
    assert data_set.read(kapture, by_folder=True, radius=5).notes[-1] == "The sequence query has no poses."


@pytest.mark.parametrize(
    ("file", "lines", "message"),
    [
        ("records_camera.txt", ["0, lidar, a.jpg"], r"records_camera\.txt, line 1 names the camera 'lidar'"),
        ("records_camera.txt", ["x, cam0, a.jpg"], "holds 'x' where a time stamp must be"),
        ("records_camera.txt", ["0, cam0, ../a.jpg"], "is not inside the data set"),
        ("records_camera.txt", ["0, cam0"], "has 2 fields, but must have 3"),
        ("records_camera.txt", [], "names no image"),
        ("sensors.txt", ["cam0"], r"sensors\.txt, line 1 has 1 fields"),
        ("trajectories.txt", ["0, cam0, 2, 0, 0, 0, 0, 0, 0"], "whose length is not 1"),
        ("trajectories.txt", ["0, cam0, 1, 0, 0, 0, 0"], "has 7 fields, but must have 8"),
        ("trajectories.txt", ["5, cam0, 1, 0, 0, 0, 0, 0, 0"], "there is none with a pose"),
    ],
)
def test_mistakes_name_file_and_line(data_set: Any, file: str, lines: list[str], message: str) -> None:
    write(data_set, ".", ["0, cam0, a.jpg"], ["0, cam0, 1, 0, 0, 0, 0, 0, 0"])
    data_set.text(f"sensors/{file}", lines)
    with pytest.raises(RouteError, match=message):
        data_set.read(kapture)


def test_rigs_that_carry_one_another_in_a_circle(data_set: Any) -> None:
    circle = ["a, b, 1, 0, 0, 0, 0, 0, 0", "b, a, 1, 0, 0, 0, 0, 0, 0", "a, cam0, 1, 0, 0, 0, 0, 0, 0"]
    write(data_set, ".", ["0, cam0, a.jpg"], ["0, cam1, 1, 0, 0, 0, 0, 0, 0"], circle)
    with pytest.raises(RouteError, match="none with a pose"):
        data_set.read(kapture)


@given(
    st.text(st.sampled_from("01, cam.jpg-e#\n"), max_size=60),
    st.sampled_from(["records_camera", "trajectories", "rigs"]),
)
@fuzzed(80)
def test_any_text_is_a_sequence_or_one_error(data_set: Any, text: str, file: str) -> None:
    pose = "0, cam0, 1, 0, 0, 0, 0, 0, 0"
    write(data_set, ".", ["0, cam0, a.jpg"], [pose], [pose.replace("0, cam0", "r, cam0")])
    path = data_set.root / "sensors" / f"{file}.txt"
    path.write_text(path.read_text() + text)
    try:
        route = data_set.read(kapture)
    except RouteError as error:
        assert "\n" not in str(error)
    else:
        assert [one.count for one in route.traverses] >= [1]
