"""The place-recognition convention with coordinates in file names."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed

from everplace.errors import RouteError
from everplace.importing.sources import vpr

PITTS = "@0584852.84@4477220.18@17@T@0040.44@-079.99@000001@03@{heading}@012@@@{time}@@.jpg"
DATABASE = [PITTS.format(heading="090", time=""), "@0584900.00@4477220.18@17@T@0040.44@-079.99@000002@@@@@@@@.jpg"]
QUERIES = ["@0584853.0@4477221.0@.jpg", "night/@584999@4477000.5@17@T@@@7@@@@@@@@.png"]


def write(data_set: Any, split: str = "images/test") -> None:
    data_set.images(f"{split}/database", DATABASE)
    data_set.images(f"{split}/queries", QUERIES)


@pytest.mark.parametrize(("split", "where"), [("images/test", "."), ("test", "."), ("images/test", "images/test")])
def test_poses_come_from_the_names(data_set: Any, split: str, where: str) -> None:
    write(data_set, split)
    route = data_set.read(vpr, where)
    assert route.radius == 25.0
    assert route.tolerance is None
    frames = data_set.frames(vpr, where)
    assert list(frames) == ["database", "queries"]
    first, second = frames["database"]
    assert first.stem == DATABASE[0].removesuffix(".jpg")
    assert first.pose == (584852.84, 4477220.18, 0.0)  # compass 90 degrees: east, the x axis
    assert second.pose == (584900.0, 4477220.18, 0.0)
    assert [frame.stem for frame in frames["queries"]] == [
        "@0584853.0@4477221.0@", "night-@584999@4477000.5@17@T@@@7@@@@@@@@",
    ]  # fmt: skip
    assert frames["queries"][1].content.name == QUERIES[1].rpartition("/")[2]


def test_headings_and_times(data_set: Any) -> None:
    names = [PITTS.format(heading=heading, time="20190101_123000") for heading in ("000", "180", "359")]
    data_set.images("images/val/database", names)
    data_set.images("images/val/queries", [*names, QUERIES[0]])
    frames = data_set.frames(vpr, split="val", radius=10)
    north, south, almost = sorted(frames["database"], key=lambda frame: frame.stem)
    assert north.pose.heading == pytest.approx(math.pi / 2)
    assert south.pose.heading == pytest.approx(3 * math.pi / 2)
    assert math.degrees(almost.pose.heading) == pytest.approx(91)
    assert north.seconds == 1546345800.0
    assert {frame.seconds for frame in frames["queries"]} == {None}  # one of them has none
    assert data_set.read(vpr, split="val", radius=10).radius == 10


def test_zones_do_not_overlap(data_set: Any) -> None:
    data_set.images(
        "images/test/database", ["@500000@6000000@33@U@@@a@@@@@@@@.jpg", "@500000@6000000@10@S@@@b@@@@@@@@.jpg"]
    )
    data_set.images("images/test/queries", ["@500001@6000000@33@U@@@c@@@@@@@@.jpg"])
    frames = data_set.frames(vpr)
    assert sorted(frame.pose.x for frame in frames["database"]) == [500000.0, 1500000.0]
    assert frames["queries"][0].pose.x == 1500001.0
    assert "zones 10, 33" in data_set.read(vpr).notes[1]


def test_an_imported_set_is_evaluated_by_its_poses(data_set: Any) -> None:
    write(data_set)
    route = data_set.imported("vpr")
    assert route.truth_origin == "the positions (UTM) in the names of the data set's images"
    assert route.radius == 25.0
    assert not route.matched_by_stem
    assert len(route["queries"]) == 2
    assert route["database"].poses is not None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plain.jpg", r"queries/plain\.jpg is not of the form @UTM_east@UTM_north"),
        ("@1.jpg", "is not of the form"),
        ("@x@2@.jpg", r"queries/@x@2@\.jpg holds 'x' as its UTM east"),
        ("@1@nan@.jpg", "holds 'nan' as its UTM north"),
        ("@1@1e300@.jpg", "holds '1e300' as its UTM north"),
        ("@1@2@zone@T@@@a@@@@@@@@.jpg", "holds 'zone' as its UTM zone"),
        ("@1@2@17@T@@@a@@east@@@@@@.jpg", "holds 'east' as its heading"),
    ],
)
def test_bad_names_are_named(data_set: Any, name: str, message: str) -> None:
    write(data_set)
    data_set.images("images/test/queries", [name])
    with pytest.raises(RouteError, match=message):
        data_set.read(vpr)


def test_two_files_of_one_stem_and_what_is_missing(data_set: Any) -> None:
    with pytest.raises(RouteError, match="holds no images/test .* give the directory above images"):
        data_set.read(vpr)
    write(data_set, "images/val")
    with pytest.raises(RouteError, match="choose `split`= one of val"):
        data_set.read(vpr)
    data_set.images("images/val/queries", ["@0584853.0@4477221.0@.png"])
    with pytest.raises(RouteError, match=r"would both be the frame '@0584853\.0@4477221\.0@'"):
        data_set.read(vpr, split="val")


@given(fields=st.lists(st.text(st.characters(codec="utf-8", exclude_characters="/@\0"), max_size=6), max_size=17))
@fuzzed(100)
def test_any_name_gives_a_pose_or_one_error(data_set: Any, fields: list[str]) -> None:
    name = "@".join(fields) + ".jpg"
    try:
        place = vpr._place(data_set.root, name)
    except RouteError as error:
        assert str(data_set.root) in str(error)
    else:
        assert all(map(math.isfinite, (place.east, place.north, place.heading)))
