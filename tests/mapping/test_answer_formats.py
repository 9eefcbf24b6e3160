"""The files for SLAM and reconstruction, read back by readers that are not ours."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from everplace.mapping.answer_formats import (
    COLUMNS,
    LocatedFrame,
    csv_text,
    g2o_text,
    hloc_pairs_text,
    tum_text,
)
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
    LocatedFrame('a"b', ANSWER),
    LocatedFrame("b", replace(ANSWER, place=9, pose=None, time=None)),
    LocatedFrame("c", replace(ANSWER, pose=Pose(13.5, -3.0, -3.0), time=None)),
]


def test_csv_is_read_back_by_columns() -> None:
    rows = list(csv.DictReader(io.StringIO(csv_text(LOCATED))))
    assert tuple(rows[0]) == COLUMNS
    assert [row["frame"] for row in rows] == ['a"b', "b", "c"]
    assert rows[0] == {
        "frame": 'a"b', "time": "1700000000.125000", "place": "7", "drive": "summer, first",
        "database_frame": "00007", "score": "0.875", "probability": "0.96", "off_map": "0.03",
    }  # fmt: skip
    assert (rows[1]["time"], rows[1]["place"]) == ("", "9")


def test_tum_is_read_back_as_poses() -> None:
    table = np.loadtxt(io.StringIO(tum_text(LOCATED)))
    np.testing.assert_allclose(table[:, 0], [1700000000.125, 2])
    np.testing.assert_allclose(table[:, 1:4], [[12.5, -3.25, 0], [13.5, -3.0, 0]])
    headings = Rotation.from_quat(table[:, 4:]).as_euler("zyx")[:, 0]
    np.testing.assert_allclose(headings, [2.5, -3.0], atol=1e-8)


def test_g2o_is_read_back_as_a_graph() -> None:
    vertices, edges, fixed = {}, [], set()
    for line in g2o_text(LOCATED).splitlines():
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
    one = [LocatedFrame("w1.png", replace(ANSWER, drive="summer"))]
    (tmp_path / "pairs.txt").write_text(hloc_pairs_text(one))
    found: dict[str, list[str]] = {}
    for line in (tmp_path / "pairs.txt").read_text().rstrip("\n").split("\n"):  # as hloc's parse_retrieval reads it
        query, database = line.split()
        found.setdefault(query, []).append(database)
    assert found == {"w1.png": ["summer/00007"]}


@pytest.mark.parametrize("write", [tum_text, g2o_text, hloc_pairs_text])
def test_without_frames_there_is_nothing(write: object) -> None:
    assert callable(write)
    assert write([]) == ""
    assert csv_text([]).splitlines() == [",".join(COLUMNS)]
