"""TUM RGB-D sequences."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.sources import tum

START = 1305031102.0
# The optical frame (x right, y down, z ahead) of a level camera that looks along the world's x axis, z up.
LEVEL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def write(data_set: Any, sequence: str = ".", frames: int = 4, poses: int = 3) -> None:
    stamps = [f"{START + index:.6f}" for index in range(frames)]
    data_set.images(f"{sequence}/rgb", [f"{stamp}.png" for stamp in stamps])
    data_set.text(f"{sequence}/rgb.txt", ["# colour images", *(f"{stamp} rgb/{stamp}.png" for stamp in stamps)])
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for index in range(2 * poses):
        turned = Rotation.from_euler("z", 90 * index / 2, degrees=True) * LEVEL
        q = " ".join(f"{value:.4f}" for value in turned.as_quat())
        lines.append(f"{START + index / 2 - 0.25:.4f} {index / 2 - 0.25:.4f} {2 * index:.4f} 1.3 {q}")
    data_set.text(f"{sequence}/groundtruth.txt", lines)


def test_poses_are_interpolated_and_laid_onto_the_plane(data_set: Any) -> None:
    write(data_set)
    ((name, frames),) = data_set.frames(tum, limit=0.3).items()
    assert name == "set"
    assert [frame.stem for frame in frames] == [f"{START + index:.6f}" for index in range(3)]
    assert [frame.seconds for frame in frames] == [START + index for index in range(3)]
    for index, frame in enumerate(frames):
        # Halfway between two poses: at time t the camera is at (t, 4 t + 1) and has turned by 90 t + 22.5 degrees.
        assert frame.pose.x == pytest.approx(index, abs=1e-3)
        assert frame.pose.y == pytest.approx(4 * index + 1, abs=1e-3)
        turned = math.degrees(frame.pose.heading) - 90 * index - 22.5
        assert (turned + 180) % 360 - 180 == pytest.approx(0, abs=0.1)


def test_times_that_lost_trailing_zeros_are_in_their_order(data_set: Any) -> None:
    stamps = ["1305031110.0", "1305031110.125", "1305031110.25", "1305031110.375", "1305031110.5"]
    data_set.images("rgb", [f"{stamp}.png" for stamp in stamps])
    data_set.text("rgb.txt", [f"{stamp} rgb/{stamp}.png" for stamp in stamps])
    (traverse,) = data_set.imported("tum").traverses
    assert list(traverse.stems) == stamps


def test_frames_without_a_pose_are_left_out_and_said(data_set: Any) -> None:
    write(data_set)
    notes = data_set.read(tum, limit=0.3).notes
    assert notes[0].startswith("1 of 4 frames of set have no pose within 0.3 s and were left out")
    assert "radius for the same place: say it in metres" in notes[1]
    kept = data_set.frames(tum, poses=False)["set"]
    assert len(kept) == 4
    assert {frame.pose for frame in kept} == {None}
    with pytest.raises(RouteError, match=r"of the 4 images .* none with a pose: no pose within 0\.02 s"):
        data_set.read(tum)


def test_several_sequences_are_imported(data_set: Any) -> None:
    write(data_set, "desk2")
    write(data_set, "desk10", frames=3)
    (data_set.root / "desk10" / "groundtruth.txt").unlink()
    route = data_set.imported("tum", limit="0.3", radius="1")
    assert {traverse.name: len(traverse) for traverse in route.traverses} == {"desk2": 3, "desk10": 3}
    assert route.radius is None  # one of them has no poses
    assert route["desk2"].poses is not None
    assert route.truth_origin is None
    alone = data_set.read(tum, "desk2", limit=0.3, radius=1)
    assert (alone.radius, alone.truth_from) == (1, "the poses of the data set")


@pytest.mark.parametrize(
    ("file", "lines", "message"),
    [
        ("rgb.txt", ["1.0"], r"rgb\.txt, line 1 has 1 fields, but must have 2"),
        ("rgb.txt", ["now rgb/1.png"], r"line 1 holds 'now' where a number must be"),
        ("rgb.txt", ["1.0 ../x.png"], "is not inside the data set"),
        ("rgb.txt", ["# nothing"], r"rgb\.txt names no image"),
        ("rgb.txt", ["1.0 a/1.png", "2.0 b-1.png", "3.0 b/1.png"], r"'b-1\.png' and 'b/1\.png' in .* both"),
        ("groundtruth.txt", ["1 2 3"], r"groundtruth\.txt, line 1 has 3 fields"),
        ("groundtruth.txt", ["1 2 3 4 0 0 0 0"], "line 1 holds the quaternion .* whose length is not 1"),
        ("groundtruth.txt", ["1 2 3 inf 0 0 0 1"], "holds 'inf' where a number must be"),
        ("groundtruth.txt", [], r"groundtruth\.txt holds no pose"),
    ],
)
def test_mistakes_name_file_and_line(data_set: Any, file: str, lines: list[str], message: str) -> None:
    write(data_set)
    data_set.text(file, lines)
    with pytest.raises(RouteError, match=message):
        data_set.read(tum)


def test_what_is_not_there(data_set: Any) -> None:
    with pytest.raises(RouteError, match=r"nor a directory in it holds rgb\.txt"):
        data_set.read(tum)
    write(data_set)
    next((data_set.root / "rgb").iterdir()).unlink()
    with pytest.raises(RouteError, match=r"does not exist, but .*rgb\.txt names it"):
        data_set.frames(tum, poses=False)


@given(st.text(st.sampled_from("0123456789.-e \n#/r"), max_size=60), st.booleans())
@fuzzed(80)
def test_any_text_is_a_sequence_or_one_error(data_set: Any, text: str, truth: bool) -> None:
    data_set.text("rgb.txt", ["1.0 rgb/1.png", "" if truth else text])
    data_set.text("groundtruth.txt", ["1.0 0 0 0 0 0 0 1", text if truth else ""])
    try:
        route = data_set.read(tum)
    except RouteError as error:
        assert "\n" not in str(error)
    else:
        assert [one.count for one in route.traverses] >= [1]


def test_an_image_named_twice_is_refused_with_the_line(data_set: Any) -> None:
    write(data_set, "desk")
    listing = data_set.root / "desk/rgb.txt"
    lines = listing.read_text().splitlines()
    data_set.text("desk/rgb.txt", [*lines, lines[-1]])
    with pytest.raises(RouteError, match=rf"rgb\.txt, line {len(lines) + 1} names the image '.*' a second time"):
        data_set.read(tum, "desk")
