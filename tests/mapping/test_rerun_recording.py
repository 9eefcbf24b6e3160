"""Recordings for the Rerun viewer, read back by its own reader."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
import pytest
from tests.cli.test_main import call, refused, run
from tests.mapping.drives import images_of, write_video

from everplace.errors import StorageError
from everplace.mapping.frame_stream import SeenFrame
from everplace.mapping.localizer import Localizer
from everplace.mapping.rerun_recording import BARS, _Copy, rerun_recording

pytest.importorskip("rerun", reason="needs the extra rerun")


def read(path: Path) -> dict[str, list[dict[str, Any]]]:
    """The rows of each entity, in the order of frames."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    assert [entry.application_id for entry in reader.recordings()] == ["everplace"]
    rows: dict[str, list[dict[str, Any]]] = {}
    for chunk in reader.stream():
        rows.setdefault(chunk.entity_path.lstrip("/"), []).extend(chunk.to_record_batch().to_pylist())
    return {name: sorted(found, key=lambda row: row.get("frame", 0)) for name, found in rows.items()}


def only(rows: list[dict[str, Any]], column: str) -> list[Any]:
    return [row[column][0] for row in rows]


def test_a_recording_holds_what_was_answered(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    out = tmp_path / "drive.rrd"
    status, printed, err = call(
        "localize", unchanged_three_map, unchanged_rendered_route / "autumn", "--json-lines", "--rerun", out
    )
    assert status == 0, err
    assert [path.name for path in tmp_path.iterdir()] == ["drive.rrd"]
    answers = [json.loads(line) for line in printed.splitlines()]
    rows = read(out)
    assert [row["frame"] for row in rows["query/image"]] == list(range(60))
    assert only(rows["answer/probability"], "Scalars:scalars") == [answer["probability"] for answer in answers]
    assert only(rows["answer/off_map"], "Scalars:scalars") == [answer["off_map"] for answer in answers]
    for name in ("summer", "autumn", "winter"):
        told = only(rows[f"condition/{name}"], "Scalars:scalars")
        assert told == [answer["condition"][name] for answer in answers]
        assert len(rows[f"route/{name}"][0]["LineStrips3D:strips"][0]) == 60
    shown = np.array(only(rows["route/match"], "Points3D:positions"))
    np.testing.assert_allclose(shown[:, :2], [answer["pose"][:2] for answer in answers], rtol=1e-5)
    belief = np.array([bars["buffer"] for bars in only(rows["belief/places"], "BarChart:values")])
    assert belief.shape == (60, 60)
    for bars, answer in zip(belief, answers, strict=True):
        near = bars[max(answer["place"] - 1, 0) : answer["place"] + 2].sum()
        assert near == pytest.approx(answer["probability"], abs=1e-5)
    assert "place 59 with" in only(rows["match/text"], "TextDocument:text")[59]


def test_the_pictures_are_those_of_the_frame_and_of_its_match(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    localizer = Localizer(unchanged_three_map, sequence=1)
    image = images_of(unchanged_rendered_route / "winter")[20]
    with rerun_recording(tmp_path / "one.rrd", localizer) as recording:
        observation = localizer.observe(image)
        recording.add(SeenFrame("20", image, None), observation)
    answer = observation.answer
    rows = read(tmp_path / "one.rrd")
    query, match = (
        cv2.imdecode(np.array(only(rows[name], "EncodedImage:blob")[0], np.uint8), cv2.IMREAD_COLOR_RGB)
        for name in ("query/image", "match/image")
    )
    found = images_of(unchanged_rendered_route / answer.drive)[int(answer.database_frame)]
    for seen, meant, other in ((query, image, found), (match, found, image)):
        assert seen is not None
        assert np.abs(seen.astype(int) - meant).mean() < 6
        if answer.drive != "winter":
            assert np.abs(seen.astype(int) - other).mean() > 12


def test_a_video_has_its_times_and_a_map_without_poses_no_route(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    images = images_of(unchanged_rendered_route / "summer")[:12]
    video = write_video(tmp_path / "drive.mp4", images, rate=5)
    assert call("map", "create", tmp_path / "map", "--drive", video, "--method", "hog16")[0] == 0
    status, _, err = call("localize", tmp_path / "map", video, "--json-lines", "--rerun", tmp_path / "x.rrd")
    assert status == 0, err
    rows = read(tmp_path / "x.rrd")
    seconds = [row["time"].total_seconds() for row in rows["query/image"]]
    assert seconds == pytest.approx(np.arange(12) / 5)
    assert not any("Points3D:positions" in row for row in rows.get("route/match", []))
    assert not [name for name in rows if name.startswith("route/") and name != "route/match"]


def test_a_recording_leaves_memory_as_it_grows(unchanged_summer_map: Path, tmp_path: Path) -> None:
    localizer = Localizer(unchanged_summer_map)
    images = np.random.default_rng(1).integers(0, 256, (40, 240, 640, 3), dtype=np.uint8)
    with rerun_recording(tmp_path / "one.rrd", localizer) as recording:
        for number, image in enumerate(images):
            recording.add(SeenFrame(str(number), image, None), localizer.observe(image))
        (part,) = tmp_path.iterdir()
        assert part.name != "one.rrd"
        for _ in range(100):  # the SDK hands on what it has every 0.2 s
            if (written := part.stat().st_size) > 1_000_000:
                break
            time.sleep(0.1)
        assert written > 1_000_000
    assert [path.name for path in tmp_path.iterdir()] == ["one.rrd"]
    assert len(read(tmp_path / "one.rrd")["query/image"]) == 40


def test_a_recording_that_cannot_be_written_is_told_meanwhile(
    unchanged_summer_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk ends the drive, also where it has no end."""
    localizer = Localizer(unchanged_summer_map)
    image = np.random.default_rng(1).integers(0, 256, (64, 128, 3), dtype=np.uint8)
    seen = localizer.observe(image)

    def full(copy: _Copy, pipe: int, _: BinaryIO) -> None:
        begin(copy, pipe, device)

    begin = _Copy.__init__
    monkeypatch.setattr(_Copy, "__init__", full)
    with (
        Path("/dev/full").open("wb", buffering=0) as device,
        pytest.raises(StorageError, match=r"cannot write .*one.rrd: No space left on device; free space"),
        rerun_recording(tmp_path / "one.rrd", localizer) as recording,
    ):
        for number in range(100_000):
            recording.add(SeenFrame(str(number), image, None), seen)
    assert number < 99_999
    assert list(tmp_path.iterdir()) == []


def test_a_long_route_has_fewer_bars(
    unchanged_summer_map: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert BARS >= 60
    monkeypatch.setattr("everplace.mapping.rerun_recording.BARS", 25)
    localizer = Localizer(unchanged_summer_map)
    image = np.random.default_rng(1).integers(0, 256, (64, 128, 3), dtype=np.uint8)
    with rerun_recording(tmp_path / "one.rrd", localizer) as recording:
        observation = localizer.observe(image)
        recording.add(SeenFrame("0", image, None), observation)
    bars = read(tmp_path / "one.rrd")["belief/places"][0]
    assert bars["BarChart:abscissa"][0]["buffer"] == list(range(0, 60, 3))
    greatest = observation.belief.reshape(20, 3).max(axis=1)
    np.testing.assert_allclose(bars["BarChart:values"][0]["buffer"], greatest, rtol=1e-5)


def test_without_the_extra_it_is_named(
    unchanged_summer_map: Path, unchanged_rendered_route: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    told = refused("localize", unchanged_summer_map, unchanged_rendered_route / "summer", "--rerun", tmp_path / "x.rrd")
    assert told == (
        "everplace: a recording for the Rerun viewer needs an optional dependency: pip install 'everplace[rerun]'"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["x.txt", "."])
def test_a_file_of_another_kind_is_refused(unchanged_summer_map: Path, tmp_path: Path, name: str) -> None:
    assert "--rerun" in refused("localize", unchanged_summer_map, ".", "--rerun", tmp_path / name)


@pytest.mark.slow
def test_a_full_disk_is_one_sentence_and_leaves_nothing(
    unchanged_summer_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    status, _, err = run(
        "localize", unchanged_summer_map, unchanged_rendered_route / "summer", "--json-lines",
        "--rerun", tmp_path / "x.rrd", limit_file_size=30_000,
    )  # fmt: skip
    assert status == 1
    assert err == f"everplace: cannot write {tmp_path / 'x.rrd'}: File too large; free space or choose another place\n"
    assert list(tmp_path.iterdir()) == []
