"""Which files of a directory are parts of one drive."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from everplace.errors import ConfigError
from everplace.importing.import_route import import_route
from everplace.importing.recording_parts import PartOptions, Recording, find_recordings, split_drives


@pytest.mark.parametrize(
    ("names", "drives"),
    [
        # GoPro's HERO 6 and later: the chapter comes before the number of the video.
        (["GX010012.MP4", "GX010013.MP4", "GX020012.MP4"], [["GX010012.MP4", "GX020012.MP4"]]),
        (["GH010007.mp4", "GH020007.mp4", "GH030007.mp4"], [["GH010007.mp4", "GH020007.mp4", "GH030007.mp4"]]),
        (["GP010012.MP4", "GP020012.MP4", "GOPR0012.MP4"], [["GOPR0012.MP4", "GP010012.MP4", "GP020012.MP4"]]),
        # rosbag record --split, with a name of its own and with the time of each part.
        (["drive_0.bag", "drive_1.bag", "drive_2.bag"], [["drive_0.bag", "drive_1.bag", "drive_2.bag"]]),
        (
            ["2024-01-05-10-00-00_0.bag", "2024-01-05-10-05-00_1.bag", "2024-01-05-11-00-00_0.bag"],
            [["2024-01-05-10-00-00_0.bag", "2024-01-05-10-05-00_1.bag"]],
        ),
        # ros2 bag record without its metadata.yaml, and the order of numbers.
        ([f"run_{n}.mcap" for n in (0, 1, 10, 2, 3, 4, 5, 6, 7, 8, 9)], [[f"run_{n}.mcap" for n in range(11)]]),
        (["a_0.db3", "a_1.db3", "b_0.db3", "b_1.db3"], [["a_0.db3", "a_1.db3"], ["b_0.db3", "b_1.db3"]]),
        (["spring.mp4", "winter.mp4"], []),
        (["2024_01_05.mp4", "2024_01_06.mp4"], []),
        (["GX010012.MP4", "GX010013.MP4"], []),
        (["drive_1.bag", "drive_2.bag"], []),
        (["a_0.bag", "b_0.bag"], []),
        (["day_0.bag", "night_1.bag"], []),
        (["a_0.bag", "a_1.mcap"], []),
    ],
)
def test_names_that_look_like_parts_of_one_drive(names: Sequence[str], drives: list[list[str]]) -> None:
    assert split_drives(names) == drives


def listed(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir() if path.suffix == ".avi")


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    for name in ("videos/GX010012.avi", "videos/GX010013.avi", "videos/GX020012.avi"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path / "videos"


def names(found: list[Recording]) -> dict[str, list[str]]:
    return {recording.name: [part.name for part in recording.parts] for recording in found}


def test_all_files_or_some_or_each_by_itself(parts: Path) -> None:
    """Chapters come after those of the video before, which the order of their names would mix."""
    found, notes = find_recordings(parts, ["true"], listed)
    assert (names(found), notes) == ({"videos": ["GX010012.avi", "GX020012.avi", "GX010013.avi"]}, [])
    found, notes = find_recordings(parts, ["GX010013.avi", "GX010012.avi"], listed)
    assert names(found) == {"videos": ["GX010013.avi", "GX010012.avi"]}
    assert notes == ["Recordings that join does not name were not read: GX020012.avi."]
    found, notes = find_recordings(parts, [], listed)
    assert names(found) == {stem: [f"{stem}.avi"] for stem in ("GX010012", "GX010013", "GX020012")}
    assert notes == [
        f"GX010012.avi and GX020012.avi in {parts} look like parts of one drive, but each became a drive of its own; "
        "if they are, put the parts of each drive into a directory of its own and import with `join=true`."
    ]
    (parts / "GX010013.avi").unlink()
    (note,) = find_recordings(parts, [], listed)[1]
    assert note.endswith("; if they are, import with `join=true`.")


def test_each_directory_is_a_drive(parts: Path) -> None:
    (parts.parent / "empty").mkdir()
    (parts.parent / "autumn").mkdir()
    (parts.parent / "autumn/0.avi").touch()
    found, _ = find_recordings(parts.parent, ["true"], listed)
    assert sorted(names(found)) == ["autumn", "videos"]
    assert find_recordings(parts.parent, [], listed) == ([], [])


def test_a_part_that_is_given_by_itself(parts: Path) -> None:
    found, notes = find_recordings(parts / "GX020012.avi", [], listed)
    assert names(found) == {"GX020012": ["GX020012.avi"]}
    assert notes == [
        f"{parts / 'GX020012.avi'} looks like one of 2 parts of a drive, and the others were not read; if it is, give "
        "the directory and `join=GX010012.avi,GX020012.avi`."
    ]
    assert find_recordings(parts / "GX010013.avi", ["true"], listed)[1] == []


@pytest.mark.parametrize(
    ("join", "message"),
    [
        ("a.mkv,b.mkv", "`join` names 'a.mkv', which is no recording in .*videos; there are: none"),
        ("a.mkv,a.mkv", "`join` names a file twice"),
    ],
)
def test_files_that_cannot_be_joined(tmp_path: Path, join: str, message: str) -> None:
    (tmp_path / "videos").mkdir()
    for kind in ("video", "bag"):
        with pytest.raises(ConfigError, match=message):
            import_route(kind, tmp_path / "videos", tmp_path / "out", {"join": join})


def test_true_and_false_stand_for_all_files_and_none() -> None:
    assert [PartOptions.model_validate({"join": value}).join for value in (True, ["True"], ["true"])] == [("true",)] * 3
    assert [PartOptions.model_validate({"join": value}).join for value in (False, ["false"], ())] == [()] * 3


def test_one_recording_has_no_files_to_join(parts: Path) -> None:
    with pytest.raises(ConfigError, match=r"names files of a directory, and .*GX010012\.avi is one recording"):
        find_recordings(parts / "GX010012.avi", ["GX010012.avi"], listed)
