"""`everplace localize`."""

from __future__ import annotations

import csv
import io
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.cli.test_main import call, refused
from tests.forked import ForkedProcess
from tests.mapping.drives import images_of, write_video

KEYS = {
    "frame", "time", "place", "drive", "database_frame", "score", "probability", "off_map", "condition",
    "unseen_condition", "pose", "provisional",
}  # fmt: skip


def lines(*arguments: str | Path) -> list[dict[str, Any]]:
    status, out, err = call("localize", *arguments, "--json-lines")
    assert status == 0, err
    return [json.loads(line) for line in out.splitlines()]


def test_json_lines_are_what_others_build_on(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    found = lines(unchanged_three_map, unchanged_rendered_route / "winter")
    assert [line["frame"] for line in found] == [f"{place:05d}" for place in range(60)]
    for place, line in enumerate(found):
        assert set(line) == KEYS
        assert abs(line["place"] - place) <= 1
        assert line["database_frame"] == f"{line['place']:05d}"
        assert set(line["condition"]) == {"summer", "autumn", "winter"}
        assert len(line["pose"]) == 3
        assert line["time"] is None
        assert line["provisional"] is False
        assert 0 <= line["probability"] <= 1
        assert 0 <= line["off_map"] <= 1


def test_a_map_of_one_drive_says_that_it_is_provisional(
    unchanged_summer_map: Path, unchanged_rendered_route: Path
) -> None:
    status, out, err = call("localize", unchanged_summer_map, unchanged_rendered_route / "autumn", "--json-lines")
    assert status == 0
    assert all(json.loads(line)["provisional"] for line in out.splitlines())
    assert "so its probabilities are provisional; add another drive" in err
    assert "60 frames localised" in err


def test_a_video_is_answered_by_its_numbers_and_times(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    video = write_video(tmp_path / "drive.mp4", images_of(unchanged_rendered_route / "autumn")[20:40])
    found = lines(unchanged_three_map, video)
    assert [int(line["frame"]) for line in found] == list(range(20))
    assert [line["time"] for line in found] == pytest.approx(np.arange(20) / 10)
    assert np.mean([abs(line["place"] - 20 - number) <= 1 for number, line in enumerate(found)]) >= 0.95


def test_without_a_sequence_each_frame_stands_alone(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    whole = lines(unchanged_three_map, unchanged_rendered_route / "autumn", "--sequence", "off")
    assert whole == lines(unchanged_three_map, unchanged_rendered_route / "autumn", "--sequence", "1")
    (tmp_path / "one").mkdir()
    for path in (unchanged_rendered_route / "autumn").glob("00030.*"):
        (tmp_path / "one" / path.name).write_bytes(path.read_bytes())
    assert lines(unchanged_three_map, tmp_path / "one", "--sequence", "off") == [whole[30]]


def test_a_drive_is_left_out_of_its_own_search(unchanged_three_map: Path, unchanged_rendered_route: Path) -> None:
    drive = unchanged_rendered_route / "winter"
    found = lines(unchanged_three_map, drive, "--exclude", "5", "--sequence", "off")
    assert all(line["drive"] != "winter" or abs(line["place"] - int(line["frame"])) >= 5 for line in found)
    assert np.mean([abs(line["place"] - int(line["frame"])) <= 1 for line in found]) >= 0.8
    renamed = lines(
        unchanged_three_map, unchanged_rendered_route / "autumn", "--exclude", "60", "--name", "winter",
        "--sequence", "off",
    )  # fmt: skip
    assert {line["drive"] for line in renamed} <= {"summer", "autumn"}


def test_a_drive_that_the_map_does_not_hold_cannot_be_left_out(
    unchanged_summer_map: Path, unchanged_rendered_route: Path
) -> None:
    told = refused("localize", unchanged_summer_map, unchanged_rendered_route / "autumn", "--exclude", "5")
    assert "the map holds no drive 'autumn'; give one of summer by --name" in told


@pytest.mark.parametrize("precision", ["0.9", "0.99"])
def test_a_precision_keeps_the_sure_ones(
    unchanged_three_map: Path, unchanged_rendered_route: Path, precision: str
) -> None:
    drive = unchanged_rendered_route / "autumn"
    status, out, _ = call("localize", unchanged_three_map, drive, "--precision", precision)
    assert status == 0
    kept = list(csv.DictReader(io.StringIO(out)))
    found = lines(unchanged_three_map, drive, "--precision", precision)
    assert [row["frame"] for row in kept] == [line["frame"] for line in found if line["accepted"]]
    accepted = [line["probability"] for line in found if line["accepted"]]
    assert min(accepted) >= max((line["probability"] for line in found if not line["accepted"]), default=0)


def test_frames_that_are_not_sure_shift_no_number(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    for number, path in enumerate(sorted((unchanged_rendered_route / "winter").iterdir())[:40]):
        shown = np.zeros((32, 64, 3), np.uint8) if 15 <= number < 25 else images_of(path.parent)[number]
        Image.fromarray(shown).save(drive / path.name)
    options = (unchanged_three_map, drive, "--sequence", "off", "--precision", "0.9")
    accepted = [number for number, line in enumerate(lines(*options)) if line["accepted"]]
    assert accepted[-1] > len(accepted)
    _, trajectory, _ = call("localize", *options, "--format", "tum")
    assert [float(row.split()[0]) for row in trajectory.splitlines()] == accepted
    _, graph, _ = call("localize", *options, "--format", "g2o")
    seen = [int(row.split()[2]) for row in graph.splitlines() if row.startswith("EDGE")]
    assert seen == [2 * number + 1 for number in accepted]


@pytest.mark.parametrize("form", ["csv", "tum", "g2o", "hloc-pairs"])
def test_a_file_holds_what_is_printed(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path, form: str
) -> None:
    drive = unchanged_rendered_route / "winter"
    status, out, _ = call("localize", unchanged_three_map, drive, "--format", form)
    assert status == 0
    status, nothing, _ = call("localize", unchanged_three_map, drive, "--format", form, "--out", tmp_path / "file")
    assert (status, nothing) == (0, "")
    assert (tmp_path / "file").read_bytes().decode() == out
    assert out.count("EDGE_SE2" if form == "g2o" else "\n") == 60 + (form == "csv")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sequence", "0"], "--sequence '0' is neither off nor a number of frames of at least 1"),
        (["--sequence", "many"], "--sequence 'many' is neither"),
        (["--precision", "1"], "--precision 1.0 is no share between 0 and 1"),
        (["--precision", "-2"], "--precision -2.0 is no share"),
    ],
)
def test_options_that_make_no_sense(unchanged_summer_map: Path, options: list[str], message: str) -> None:
    assert message in refused("localize", unchanged_summer_map, ".", *options)


@pytest.mark.parametrize("source", ["missing", "missing.mp4", "empty"])
def test_a_source_that_is_not_there_is_one_sentence(unchanged_summer_map: Path, tmp_path: Path, source: str) -> None:
    (tmp_path / "empty").mkdir()
    assert source in refused("localize", unchanged_summer_map, tmp_path / source, "--out", tmp_path / "file")
    assert not (tmp_path / "file").exists()


def test_no_map_is_one_sentence(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    told = refused("localize", tmp_path / "none", unchanged_rendered_route / "summer")
    assert "there is no map at" in told
    assert list(tmp_path.iterdir()) == []


def test_a_camera_that_is_not_there_is_one_sentence(unchanged_summer_map: Path) -> None:
    command = ["-m", "everplace", "localize", unchanged_summer_map, "/dev/video97"]
    process = ForkedProcess(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out, err = process.communicate()
    assert (process.returncode, out) == (2, "")
    assert err == ("everplace: the camera /dev/video97 cannot be opened; is it connected, and may you read it?\n")


def test_a_reader_that_stops_reading_is_no_fault(unchanged_summer_map: Path, unchanged_rendered_route: Path) -> None:
    command = ["-m", "everplace", "localize", unchanged_summer_map, unchanged_rendered_route / "summer", "--json-lines"]
    with ForkedProcess(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = process.stdout.readline()
        process.stdout.close()
        assert "Traceback" not in process.stderr.read()
    assert json.loads(first)["frame"] == "00000"


CAMERA = """
import itertools, sys
from pathlib import Path
import cv2
import numpy as np

class Camera:
    # What cv2.VideoCapture is where no camera can be plugged in: one that shows a drive again and again.
    def __init__(self, source):
        files = sorted(Path(DRIVE).glob("*.*g"))
        self.frames = itertools.cycle([cv2.imread(str(path)) for path in files])
        self.count = 0
    def isOpened(self):
        return True
    def read(self):
        if self.count == WAITS_AT:
            print("waiting", file=sys.stderr, flush=True)
            while True:
                pass
        self.count += 1
        return True, next(self.frames)
    def release(self):
        pass

cv2.VideoCapture = Camera
DRIVE = sys.argv.pop(1)
from everplace.__main__ import main
main()
"""


def interrupted(drive: Path, frames: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Localises so many frames of a camera, and then gives Ctrl-C while it waits for the next one."""
    code = CAMERA.replace("WAITS_AT", str(frames))
    command = [sys.executable, "-c", code, str(drive), "localize", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        before = ""
        while "waiting\n" not in before and (line := process.stderr.readline()):
            before += line
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        return subprocess.CompletedProcess(command, process.returncode, out, before.replace("waiting\n", "") + err)


@pytest.mark.parametrize("form", ["csv", "tum", "g2o", "hloc-pairs"])
def test_what_a_camera_showed_before_ctrl_c_is_kept(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path, form: str
) -> None:
    out = tmp_path / "file"
    done = interrupted(
        unchanged_rendered_route / "winter", 70, unchanged_three_map, "/dev/video0", "--out", out, "--format", form
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == f"everplace: stopped; 70 frames localised; they are in {out}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    text = out.read_text()
    assert text.endswith("\n")
    assert text.count("EDGE_SE2" if form == "g2o" else "\n") == 70 + (form == "csv")


def test_what_is_printed_in_the_end_is_printed_at_ctrl_c(
    unchanged_three_map: Path, unchanged_rendered_route: Path
) -> None:
    drive = unchanged_rendered_route / "winter"
    done = interrupted(drive, 70, unchanged_three_map, "/dev/video0", "--precision", "0.9")
    sure = list(csv.DictReader(io.StringIO(done.stdout)))
    assert done.returncode == 130
    assert f"everplace: stopped; 70 frames localised, {len(sure)} of them with a probability of " in done.stderr
    assert 40 < len(sure) <= 70


def test_a_recording_is_kept_at_ctrl_c(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun")
    from tests.mapping.test_rerun_recording import read

    drive, recording, out = unchanged_rendered_route / "winter", tmp_path / "x.rrd", tmp_path / "x.csv"
    done = interrupted(
        drive, 30, unchanged_three_map, "/dev/video0", "--json-lines", "--rerun", recording, "--out", out
    )
    assert done.returncode == 130
    assert done.stderr == f"everplace: stopped; 30 frames localised; they are in {out} and {recording}\n"
    assert len(done.stdout.splitlines()) == len(read(recording)["query/image"]) == 30
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.csv", "x.rrd"]


def test_ctrl_c_before_the_first_frame_leaves_nothing(
    unchanged_three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    out = tmp_path / "file"
    done = interrupted(unchanged_rendered_route / "winter", 0, unchanged_three_map, "/dev/video0", "--out", out)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "everplace: stopped\n")
    assert list(tmp_path.iterdir()) == []
