"""The files for SLAM and reconstruction, read back by readers that are not ours."""

from __future__ import annotations

import csv
import io
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from everplace.errors import StorageError
from everplace.mapping.answer_formats import COLUMNS, FORMATS, answer_file
from everplace.mapping.map_answer import MapAnswer
from everplace.route.traverse import Pose

ANSWER = MapAnswer(
    place=7,
    drive="summer, first",
    database_frame="00007",
    score=0.875,
    probability=0.96,
    off_map=0.03,
    condition={"summer": 0.7, "winter": 0.3},
    unseen_condition=False,
    pose=Pose(12.5, -3.25, 2.5),
    provisional=False,
    time=1700000000.125,
)
LOCATED = [
    ('a"b', ANSWER),
    ("b", replace(ANSWER, place=9, pose=None, time=None)),
    ("c", replace(ANSWER, pose=Pose(13.5, -3.0, -3.0), time=None)),
]


def text(form: str, located: list[tuple[str, MapAnswer]]) -> str:
    """What a file of the format holds."""
    with tempfile.TemporaryDirectory() as directory:
        with answer_file(Path(directory, "file"), FORMATS[form]) as answers:
            for number, (frame, answer) in enumerate(located):
                answers.add(number, frame, answer)
        return Path(directory, "file").read_bytes().decode()


def test_csv_is_read_back_by_columns() -> None:
    rows = list(csv.DictReader(io.StringIO(text("csv", LOCATED))))
    assert tuple(rows[0]) == COLUMNS
    assert [row["frame"] for row in rows] == ['a"b', "b", "c"]
    assert rows[0] == {
        "frame": 'a"b', "time": "1700000000.125000", "place": "7", "drive": "summer, first",
        "database_frame": "00007", "score": "0.875", "probability": "0.96", "off_map": "0.03",
    }  # fmt: skip
    assert (rows[1]["time"], rows[1]["place"]) == ("", "9")


def test_tum_is_read_back_as_poses() -> None:
    table = np.loadtxt(io.StringIO(text("tum", LOCATED)))
    np.testing.assert_allclose(table[:, 0], [1700000000.125, 2])
    np.testing.assert_allclose(table[:, 1:4], [[12.5, -3.25, 0], [13.5, -3.0, 0]])
    headings = Rotation.from_quat(table[:, 4:]).as_euler("zyx")[:, 0]
    np.testing.assert_allclose(headings, [2.5, -3.0], atol=1e-8)


def test_g2o_is_read_back_as_a_graph() -> None:
    vertices, edges, fixed = {}, [], set()
    for line in text("g2o", LOCATED).splitlines():
        tag, *rest = line.split()
        if tag == "VERTEX_SE2":
            vertices[int(rest[0])] = tuple(map(float, rest[1:]))
        elif tag == "FIX":
            fixed.add(int(rest[0]))
        else:
            assert tag == "EDGE_SE2"
            edges.append((int(rest[0]), int(rest[1]), [float(number) for number in rest[2:]]))
    assert vertices[0] == (12.5, -3.25, 2.5)
    assert fixed == {0, 4}
    assert [edge[:2] for edge in edges] == [(0, 1), (4, 5)]
    assert {vertex for edge in edges for vertex in edge[:2]} == set(vertices)
    for _, _, numbers in edges:
        assert numbers[:3] == [0, 0, 0]
        upper = np.zeros((3, 3))
        upper[np.triu_indices(3)] = numbers[3:]
        assert np.linalg.eigvalsh(upper + np.triu(upper, 1).T).min() == pytest.approx(0.96 / 0.04, rel=1e-4)


def test_pairs_for_hloc_name_two_images(tmp_path: Path) -> None:
    with answer_file(tmp_path / "pairs.txt", FORMATS["hloc-pairs"]) as answers:
        answers.add(0, "w1.png", replace(ANSWER, drive="summer"))
    found: dict[str, list[str]] = {}
    for line in (tmp_path / "pairs.txt").read_text().rstrip("\n").split("\n"):  # as hloc's parse_retrieval reads it
        query, database = line.split()
        found.setdefault(query, []).append(database)
    assert found == {"w1.png": ["summer/00007"]}


@pytest.mark.parametrize("form", ["tum", "g2o", "hloc-pairs"])
def test_without_frames_there_is_nothing(form: str) -> None:
    assert text(form, []) == ""
    assert text("csv", []).splitlines() == [",".join(COLUMNS)]


@pytest.mark.parametrize("form", list(FORMATS))
def test_rows_leave_memory_as_they_come(tmp_path: Path, form: str) -> None:
    with answer_file(tmp_path / "file", FORMATS[form]) as answers:
        for number in range(1000):
            answers.add(number, str(number), ANSWER)
        (part,) = tmp_path.iterdir()
        assert part.name != "file"
        assert part.stat().st_size > 10_000
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("form", list(FORMATS))
def test_half_a_row_is_cut_off(tmp_path: Path, form: str) -> None:
    with answer_file(tmp_path / "file", FORMATS[form]) as answers:
        answers.add(0, "1", ANSWER)
        answers._file.write(b"half")  # as where Ctrl-C comes while a row is written
    assert (tmp_path / "file").read_text() == text(form, [("1", ANSWER)])


def test_what_fails_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("before")
    with (
        pytest.raises(ZeroDivisionError),
        answer_file(tmp_path / "file", FORMATS["csv"]) as answers,
    ):
        answers.add(1 // 0, "1", ANSWER)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["before"]
    with (
        pytest.raises(StorageError, match="cannot write .*none.*; free space or choose another place"),
        answer_file(tmp_path / "file" / "none", FORMATS["csv"]),
    ):
        pass
