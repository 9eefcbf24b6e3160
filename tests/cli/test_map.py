"""`everplace map`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from tests.cli.test_main import call, refused, run
from tests.mapping.drives import copied, images_of, write_video


def asked(*arguments: str | Path) -> Any:
    """What a command prints as JSON; it must succeed and say nothing else."""
    status, out, err = call("map", *arguments, "--json")
    assert status == 0, err
    return json.loads(out)


def test_info_is_what_others_build_on(unchanged_three_map: Path) -> None:
    info = asked("info", unchanged_three_map)
    assert [{key: one[key] for key in ("name", "condition", "frames")} for one in info["drives"]] == [
        {"name": name, "condition": name, "frames": 60} for name in ("summer", "autumn", "winter")
    ]
    assert info["places"] == 60
    assert set(info["conditions"]) == {"summer", "autumn", "winter"}
    assert info["method"] == "hog16"
    assert isinstance(info["dimension"], int)
    assert info["calibration"]["provisional"] is False
    assert isinstance(info["bytes"], int)
    assert info["version"] == 3


def test_info_for_people(unchanged_three_map: Path) -> None:
    status, out, err = call("map", "info", unchanged_three_map)
    assert (status, err) == (0, "")
    for word in ("summer", "winter", "hog16", "places", "version"):
        assert word in out


@pytest.mark.slow
def test_from_two_videos_to_a_map_and_back(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    drives = {
        name: write_video(tmp_path / f"{name}.mp4", images_of(unchanged_rendered_route / name)[:40])
        for name in ("summer", "autumn")
    }
    where = tmp_path / "map"
    made = asked("create", where, "--drive", drives["summer"], "--condition", "sunny", "--method", "hog16")
    assert made["drives"][0] == {
        "name": "summer", "condition": "sunny", "frames": 40, "sure": 0, "how": "first", "learns": True
    }  # fmt: skip
    added = asked("add", where, "--drive", drives["autumn"], "--name", "second")
    assert added["name"] == "second"
    assert added["sure"] >= 30
    assert (added["version"], added["how"]) == (2, "names")
    assert [one["version"] for one in asked("versions", where)["versions"]] == [1, 2]
    assert asked("verify", where) == {"versions": 2, "faults": []}
    assert len(asked("remove", where, "second")["drives"]) == 1
    assert len(asked("restore", where, "2")["drives"]) == 2
    status, out, _ = call("map", "versions", where)
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == ["1", "2", "3", "4"]


@pytest.mark.slow
def test_names_that_are_not_believed_are_said(summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path) -> None:
    """The same names, twelve places later."""
    drive = tmp_path / "autumn"
    drive.mkdir()
    for path in (unchanged_rendered_route / "autumn").glob("*.*g"):
        if int(path.stem) >= 12:
            (drive / f"{int(path.stem) - 12:05d}{path.suffix}").write_bytes(path.read_bytes())
    status, out, err = call("map", "add", summer_map, "--drive", drive, "--no-learn", "--json")
    assert status == 0
    assert json.loads(out)["how"] == "images"
    assert (
        "the names of 'autumn' agree with 0% of what its images show, so they were not believed; the images were" in err
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["info", "missing"], "there is no map at"),
        (["info", "file"], "file is a file; a map is a directory"),
        (["info", "empty"], "there is no map at"),
        (["verify", "missing"], "there is no map at"),
        (["versions", "missing"], "there is no map at"),
        (["remove", "missing", "winter"], "there is no map at"),
        (["restore", "missing", "1"], "there is no map at"),
        (["add", "missing", "--drive", "drive"], "there is no map at"),
        (["create", "file", "--drive", "drive"], "file is a file; a map is a directory"),
        (["create", "new", "--drive", "missing"], "missing"),
        (["create", "new", "--drive", "empty"], "empty"),
        (["create", "new", "--drive", "drive", "--method", "nothing"], "nothing"),
        (["create", "new", "--drive", "file"], "file is no directory of images"),
    ],
)
def test_what_cannot_be_is_one_sentence_and_leaves_nothing(
    tmp_path: Path, unchanged_rendered_route: Path, arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("empty").mkdir()
    copied(unchanged_rendered_route / "summer", Path("drive"), slice(0, 2))
    before = sorted(path.name for path in tmp_path.rglob("*"))
    assert message in refused("map", *arguments)
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["remove", "spring"], "no drive 'spring'; it holds summer"),
        (["remove", "summer"], "only drive of the map"),
        (["restore", "9"], "has no version 9; it has 1 to 1"),
    ],
)
def test_what_the_map_does_not_hold_is_told(summer_map: Path, arguments: list[str], message: str) -> None:
    assert message in refused("map", arguments[0], summer_map, *arguments[1:])


def test_damage_is_told_with_the_status_of_bad_input(summer_map: Path) -> None:
    for file in (summer_map / "descriptors.lance" / "data").iterdir():
        file.write_bytes(file.read_bytes()[:100])
    status, out, err = call("map", "verify", summer_map, "--json")
    assert status == 2
    assert json.loads(out)["faults"]
    assert err.count("\n") == 1
    assert "is damaged" in err


def test_a_full_disk_is_the_machines_fault(summer_map: Path, unchanged_rendered_route: Path) -> None:
    drive = unchanged_rendered_route / "autumn"
    status, out, err = run("map", "add", summer_map, "--drive", drive, "--no-learn", limit_file_size=50_000)
    assert (status, out) == (1, "")
    assert err == (
        f"everplace: cannot write the map {summer_map}: File too large (os error 27); "
        "free space or check the permissions\n"
    )
    assert asked("info", summer_map)["version"] == 1


def test_compare_tells_both_versions(unchanged_three_map: Path) -> None:
    compared = asked("compare", unchanged_three_map, "1", "winter")
    assert [one["version"] for one in compared["versions"]] == [1, 3]
    assert compared["known"] == compared["frames"] == 60
    status, out, err = call("map", "compare", unchanged_three_map, "1", "winter")
    assert (status, err) == (0, "")
    head, columns, earlier, newest = out.splitlines()
    assert head == "winter: 60 frames, the places of 60 are known"
    assert columns.split() == ["version", "recall", "probability", "sure", "drives"]
    assert earlier.split()[:2] == ["1", f"{compared['versions'][0]['recall']:.3f}"]
    assert newest.endswith("summer, autumn, winter, which this drive taught")
    assert "has no version 7" in refused("map", "compare", unchanged_three_map, "7", "winter")


def test_a_picture_of_how_right_the_answers_are(
    unchanged_three_map: Path, unchanged_summer_map: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "reliability.png"
    info = asked("info", unchanged_three_map, "--figure", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert info["figure"] == str(picture)
    assert info["reliability"]["answers"] > 50
    assert asked("info", unchanged_three_map)["reliability"] == info["reliability"]
    assert asked("info", unchanged_summer_map)["reliability"] is None
    message = refused("map", "info", unchanged_summer_map, "--figure", tmp_path / "none.png")
    assert "nothing shows how right its answers are; add a drive with `everplace map add`" in message
    assert not (tmp_path / "none.png").exists()
    assert "--figure" in refused("map", "info", unchanged_three_map, "--figure", tmp_path / "answers.txt")
