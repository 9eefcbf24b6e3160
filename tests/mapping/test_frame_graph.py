"""The graph of a map's frames: what it finds, and how it is kept."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from everplace.mapping.frame_graph import FrameGraph


def unit(frames: int, seed: int = 0) -> NDArray[np.float32]:
    values = np.random.default_rng(seed).normal(size=(frames, 24)).astype(np.float32)
    found: NDArray[np.float32] = values / np.linalg.norm(values, axis=1, keepdims=True)
    return found


def files(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def test_it_finds_the_nearest_best_first() -> None:
    vectors = unit(3000)
    graph = FrameGraph.build(vectors)
    shares = []
    for query in unit(50, 1):
        found = graph.nearest(query, 64)
        scores = vectors[found] @ query
        assert (np.diff(scores) <= 1e-6).all()
        shares.append(np.isin(np.argsort(-(vectors @ query))[:64], found).mean())
    assert np.mean(shares) >= 0.99


def test_frames_left_out_are_not_found_though_they_are_the_nearest() -> None:
    vectors = unit(3000)
    graph = FrameGraph.build(vectors)
    for query in unit(20, 1):
        order = np.argsort(-(vectors @ query))
        left_out = np.zeros(3000, np.bool_)
        left_out[order[:600]] = True
        found = graph.nearest(query, 32, left_out)
        assert not left_out[found].any()
        assert np.isin(order[600:632], found).mean() >= 0.95
    assert len(graph.nearest(query, 32, np.ones(3000, np.bool_))) == 0
    assert len(FrameGraph.build(vectors[:5]).nearest(query, 32)) == 5


def test_it_is_built_once_and_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vectors = unit(500)
    found = FrameGraph.kept(vectors, [tmp_path / "graph"]).nearest(vectors[7], 9)
    (name,) = files(tmp_path / "graph")
    monkeypatch.setattr(FrameGraph, "build", None)
    np.testing.assert_array_equal(FrameGraph.kept(vectors, [tmp_path / "graph"]).nearest(vectors[7], 9), found)
    assert files(tmp_path / "graph") == [name]


def test_that_of_other_frames_is_swept(tmp_path: Path) -> None:
    old, new = unit(300), unit(300, 1)
    FrameGraph.kept(old, [tmp_path])
    (before,) = files(tmp_path)
    assert FrameGraph.kept(new, [tmp_path]).nearest(new[11], 1) == [11]
    (after,) = files(tmp_path)
    assert after != before


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:-9], lambda data: data[:99] + data[98:]])
def test_a_damaged_file_is_made_anew(tmp_path: Path, damage: object) -> None:
    vectors = unit(300)
    FrameGraph.kept(vectors, [tmp_path])
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))  # type: ignore[operator]
    assert FrameGraph.kept(vectors, [tmp_path]).nearest(vectors[11], 1) == [11]
    assert len(path.read_bytes()) == len(whole)


def test_where_a_directory_cannot_be_written_to_the_next_is_used(tmp_path: Path) -> None:
    vectors = unit(300)
    (tmp_path / "file").write_text("in the way")
    assert FrameGraph.kept(vectors, [tmp_path / "file", tmp_path / "cache"]).nearest(vectors[3], 1) == [3]
    assert len(files(tmp_path / "cache")) == 1
    assert FrameGraph.kept(vectors, [tmp_path / "file"]).nearest(vectors[3], 1) == [3]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write everywhere")
def test_a_map_that_may_only_be_read(tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    (tmp_path / "map").chmod(stat.S_IRUSR | stat.S_IXUSR)
    FrameGraph.kept(unit(300), [tmp_path / "map" / "graph", tmp_path / "cache"])
    assert len(files(tmp_path / "cache")) == 1
