"""KITTI odometry sequences."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.sources import kitti


def line(ahead: float, right: float, left_turn: float) -> str:
    turn = Rotation.from_euler("y", -left_turn, degrees=True).as_matrix()  # y points down
    matrix = np.column_stack([turn, [right, 0.1, ahead]])
    return " ".join(f"{value:.6e}" for value in matrix.ravel())


def write(data_set: Any, sequence: str = "00", images: tuple[int, ...] = (0, 1, 2, 4)) -> None:
    data_set.images(f"sequences/{sequence}/image_0", [f"{index:06d}.png" for index in images])
    data_set.text(f"sequences/{sequence}/times.txt", [f"{index / 10:.6e}" for index in range(5)])
    data_set.text(f"poses/{sequence}.txt", [line(10 * index, -2 * index, 30 * index) for index in range(4)])


def test_image_and_pose_belong_together_by_number(data_set: Any) -> None:
    write(data_set)
    (frames,) = data_set.frames(kitti).values()
    assert [frame.stem for frame in frames] == ["00-000000", "00-000001", "00-000002"]
    assert [frame.seconds for frame in frames] == [0.0, 0.1, 0.2]
    for index, frame in enumerate(frames):
        assert frame.pose == pytest.approx((10 * index, 2 * index, math.radians(30 * index)), abs=1e-5)
    notes = data_set.read(kitti).notes
    assert notes[0].startswith("1 of 4 frames of 00 have no line in the file of poses and were left out")


def test_sequences_are_chosen_and_imported(data_set: Any) -> None:
    for sequence in ("00", "05", "11"):
        write(data_set, sequence, (0, 1, 3))
    (data_set.root / "poses" / "11.txt").unlink()
    route = data_set.imported("kitti", sequences="00,05", radius="25")
    assert [traverse.name for traverse in route.traverses] == ["00", "05"]
    assert route.radius == 25.0
    assert route.shared_stems() == ()
    assert len(data_set.frames(kitti)["11"]) == 3
    assert list(data_set.frames(kitti, "sequences/05")) == ["05"]
    with pytest.raises(RouteError, match="has no sequence '7'; there are: 00, 05, 11"):
        data_set.read(kitti, sequences=("7",))


@pytest.mark.parametrize(
    ("file", "lines", "message"),
    [
        ("poses/00.txt", ["1 2 3"], r"poses/00\.txt, line 1 has 3 fields, but must have 4"),
        ("poses/00.txt", ["0 " * 12], "line 1 holds no pose: the left 3×3 part"),
        ("poses/00.txt", [line(0, 0, 0).replace("1.0", "-1.0", 1)], "holds no pose"),
        ("poses/00.txt", ["1e300 " * 12], "holds no pose"),
        ("poses/00.txt", [], "holds no pose; get it again"),
        ("sequences/00/times.txt", ["0.0", "0.1"], r"times\.txt has 2 lines, but there is the image 000002"),
        ("sequences/00/times.txt", ["zero"], "holds 'zero' where a number must be"),
    ],
)
def test_mistakes_name_file_and_line(data_set: Any, file: str, lines: list[str], message: str) -> None:
    write(data_set)
    data_set.text(file, lines)
    with pytest.raises(RouteError, match=message):
        data_set.read(kitti)


def test_images_that_have_no_number(data_set: Any) -> None:
    write(data_set)
    data_set.images("sequences/00/image_0", ["000001.jpg"])
    with pytest.raises(RouteError, match="two images of one number"):
        data_set.read(kitti)
    data_set.images("sequences/00/image_0", ["cover.png"])
    with pytest.raises(RouteError, match=r"cover\.png is not the number of an image"):
        data_set.read(kitti)
    with pytest.raises(RouteError, match="nor a directory in it holds image_1/"):
        data_set.read(kitti, camera="image_1")


@given(st.text(st.sampled_from("0123456789.-e \n"), max_size=80))
@fuzzed(60)
def test_any_text_is_poses_or_one_error(data_set: Any, text: str) -> None:
    path = data_set.text("fuzzed.txt", [line(1, 2, 3), text])
    try:
        poses = kitti._read_poses(TreePath(path))
    except RouteError as error:
        assert "fuzzed.txt" in str(error)
    else:
        assert all(map(math.isfinite, poses[0]))


@pytest.mark.parametrize("camera", ["image_1", "image_2", "image_3"])
def test_another_camera_than_the_one_asked_for_is_named(tmp_path: Path, camera: str) -> None:
    (tmp_path / "sequences" / "00" / camera).mkdir(parents=True)
    (tmp_path / "sequences" / "00" / camera / "000000.png").write_bytes(b"not opened")
    with pytest.raises(RouteError, match=rf"image_0/, but there is {camera}/; take it with `camera`={camera}"):
        kitti.read(tmp_path, kitti.Options())
