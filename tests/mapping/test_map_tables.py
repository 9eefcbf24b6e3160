"""The tables of a map: whole versions, whatever a writer did, and one sentence where they are broken."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.forked import ForkedProcess

from everplace.errors import MapError, StorageError
from everplace.mapping.image_statistics import STATISTICS
from everplace.mapping.map_columns import as_matrix
from everplace.mapping.map_state import MapState
from everplace.mapping.map_tables import MapTables

F = 8


def rows(drive: str, count: int, features: int = F, seed: int = 0) -> dict[str, Any]:
    """The frames of a drive, backwards."""
    rng = np.random.default_rng(seed)
    number = np.arange(count)[::-1]
    return {
        "drive": [drive] * count,
        "number": number,
        "stem": [f"{index}é" for index in number],
        "place": number,
        "position": number.astype(float),
        "sure": number % 2 == 0,
        "between": np.full(count, -1),
        "x": np.where(number == 1, np.nan, number),
        "y": np.zeros(count),
        "heading": np.zeros(count),
        "seconds": np.full(count, np.nan),
        "features": rng.normal(size=(count, features)).astype(np.float16),
        "looks": rng.normal(size=(count, STATISTICS)).astype(np.float32),
        "thumbnail": [bytes([index]) for index in number],
    }


def document(*drives: tuple[str, int]) -> dict[str, Any]:
    return {"drives": [{"name": name, "frames": count} for name, count in drives]}


def values(count: int, dimensions: int = 4) -> Any:
    return np.arange(count * dimensions, dtype=np.float32).reshape(count, dimensions)


def made(path: Path, drives: Sequence[tuple[str, int]] = (("a", 5),)) -> MapTables:
    """A map of one version for each drive."""
    tables = MapTables(str(path))
    tables.create(F, 4)
    for version, (name, count) in enumerate(drives, start=1):
        frames = tables.add_frames(rows(name, count, seed=version))
        whole = document(*drives[:version])
        descriptors = tables.write_descriptors(values(sum(count for _, count in drives[:version])))
        tables.commit(MapState.new(version, whole, {"weight": np.eye(3)}, frames, descriptors))
    return tables


@pytest.fixture
def two(tmp_path: Path) -> MapTables:
    return made(tmp_path / "map", [("b", 5), ("a", 3)])


def test_frames_come_back_in_the_order_of_drives_and_numbers(two: MapTables) -> None:
    state = two.states()[-1]
    table = two.frames(state, ["stem", "features", "x", "sure", "thumbnail"])
    assert table["drive"].to_pylist() == ["b"] * 5 + ["a"] * 3
    assert table["number"].to_pylist() == [0, 1, 2, 3, 4, 0, 1, 2]
    assert table["stem"].to_pylist() == [f"{number}é" for number in (0, 1, 2, 3, 4, 0, 1, 2)]
    assert table["sure"].to_pylist() == [True, False, True, False, True, True, False, True]
    assert table["thumbnail"].to_pylist()[:2] == [b"\0", b"\1"]
    np.testing.assert_array_equal(np.asarray(table["x"]), [0, np.nan, 2, 3, 4, 0, np.nan, 2])
    features = as_matrix(table["features"])
    assert features.dtype == np.float16
    np.testing.assert_array_equal(features[:5], rows("b", 5, seed=1)["features"][::-1])


def test_a_state_keeps_its_numbers_and_tells_its_versions(two: MapTables) -> None:
    first, second = two.states()
    assert (first.version, second.version) == (1, 2)
    np.testing.assert_array_equal(second.arrays["weight"], np.eye(3))
    assert len(two.frames(first, [])) == 5
    np.testing.assert_array_equal(two.descriptors(first), values(5))
    np.testing.assert_array_equal(two.descriptors(second), values(8))


def test_what_no_state_names_is_not_seen_and_is_dropped_by_the_next_writer(two: MapTables) -> None:
    state = two.states()[-1]
    two.add_frames(rows("killed", 7))
    two.write_descriptors(values(15))
    assert len(two.frames(state, [])) == 8
    np.testing.assert_array_equal(two.descriptors(state), values(8))
    two.revert(state)
    version = two.add_frames(rows("c", 2))
    frames = two.frames(MapState(3, "", document(("b", 5), ("a", 3), ("c", 2)), {}, version), [])
    assert frames["drive"].to_pylist() == ["b"] * 5 + ["a"] * 3 + ["c"] * 2


def test_descriptors_may_change_their_dimension_and_old_versions_keep_theirs(two: MapTables) -> None:
    state = two.states()[-1]
    for dimensions in (9, 2):
        version = two.write_descriptors(values(8, dimensions))
        np.testing.assert_array_equal(two.descriptors(MapState(3, "", {}, {}, 0, version)), values(8, dimensions))
    np.testing.assert_array_equal(two.descriptors(state), values(8))


@pytest.mark.parametrize("name", ["o'hara", "a' OR 'a' = 'a", 'say "hello"', "straße", "a\\b"])
def test_a_drive_of_any_name_is_removed_and_no_other(tmp_path: Path, name: str) -> None:
    tables = made(tmp_path / "map", [("first", 5), (name, 3)])
    version = tables.remove_frames(name)
    left = tables.frames(MapState(3, "", document(("first", 5)), {}, version), [])
    assert left["drive"].to_pylist() == ["first"] * 5


def test_a_copy_is_the_same_map(two: MapTables, tmp_path: Path) -> None:
    copy = Path(shutil.move(shutil.copytree(two.address, tmp_path / "copy"), tmp_path / "moved"))
    shutil.rmtree(two.address)
    tables = MapTables(str(copy))
    assert [len(tables.frames(state, [])) for state in tables.states()] == [5, 8]
    np.testing.assert_array_equal(tables.descriptors(tables.states()[0]), values(5))


def test_asking_for_a_map_that_is_not_there_makes_nothing(tmp_path: Path) -> None:
    tables = MapTables(str(tmp_path / "no" / "map"))
    assert not tables.exist
    with pytest.raises(MapError, match="there is no map at .*/no/map; make one"):
        tables.states()
    assert list(tmp_path.iterdir()) == []


def test_a_creation_that_was_stopped_is_told_from_no_map(tmp_path: Path) -> None:
    tables = MapTables(str(tmp_path))
    tables.create(F, 4)
    assert tables.exist
    assert not tables.finished
    assert tables.others == []
    with pytest.raises(MapError, match="creation was stopped; make it anew"):
        tables.states()
    tables.drop()
    assert not MapTables(str(tmp_path)).exist
    assert list(tmp_path.iterdir()) == []


def test_what_is_of_no_map_is_named(two: MapTables) -> None:
    (Path(two.address) / ".lock").touch()
    assert two.others == []
    (Path(two.address) / "holiday.jpg").touch()
    assert two.others == ["holiday.jpg"]


@pytest.mark.parametrize("table", ["frames", "descriptors", "states"])
@pytest.mark.parametrize("how", ["cut", "gone", "other"])
def test_a_damaged_file_is_told_in_one_sentence(tmp_path: Path, table: str, how: str) -> None:
    tables = made(tmp_path / "map")
    for file in (tmp_path / "map" / f"{table}.lance" / "data").iterdir():
        if how == "cut":
            file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
        elif how == "gone":
            file.unlink()
        else:
            file.write_bytes(b"\xff" * file.stat().st_size)
    fresh = MapTables(tables.address)
    with pytest.raises(MapError, match="is damaged") as caught:
        state = fresh.states()[-1]
        as_matrix(fresh.frames(state, ["features"])["features"])
        fresh.descriptors(state)
    assert len(str(caught.value).splitlines()) == 1


def test_frames_that_are_not_those_of_the_drives_are_damage(two: MapTables) -> None:
    last = two.states()[-1]
    for drives in ((("b", 5), ("a", 4)), (("b", 5), ("c", 3))):
        wrong = MapState(2, "", document(*drives), {}, last.frames_version, last.descriptors_version)
        with pytest.raises(MapError, match="frames are not those of its drives"):
            two.frames(wrong, [])


FULL = """
import resource, signal, sys
import numpy as np
from everplace.errors import StorageError
from tests.mapping.test_map_tables import MapTables, rows

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
tables = MapTables(sys.argv[1])
thumbnails = {"thumbnail": [np.random.default_rng(seed).bytes(1000) for seed in range(250)]}
for write in (
    lambda: tables.add_frames({**rows("c", 250), **thumbnails}),
    lambda: tables.write_descriptors(np.random.default_rng(0).normal(size=(50_000, 4)).astype(np.float32)),
):
    try:
        write()
    except StorageError as error:
        print(error)
"""


def test_a_full_disk_is_one_sentence_and_changes_nothing(two: MapTables) -> None:
    out, err = ForkedProcess("-c", FULL, two.address, stdout=subprocess.PIPE, stderr=subprocess.PIPE).communicate()
    assert err == ""
    lines = out.splitlines()
    reason = "File too large (os error 27); free space or check the permissions"
    assert lines == [f"cannot write the map {two.address}: {reason}"] * 2
    fresh = MapTables(two.address)
    assert [len(fresh.frames(state, [])) for state in fresh.states()] == [5, 8]


def test_a_place_that_may_not_be_written_to(two: MapTables, monkeypatch: pytest.MonkeyPatch) -> None:
    table = two._open("states")

    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("lance error: LanceError(IO): Permission denied, /a/b.rs:1:2\nat /long/report")

    monkeypatch.setattr(type(table), "add", refuse)
    with pytest.raises(StorageError, match="map: Permission denied; free space or check the permissions$"):
        two.commit(MapState.new(3, {}, {}, 1, 1))


def test_of_two_states_of_one_number_the_first_counts_for_every_reader(two: MapTables) -> None:
    """As where two writers met at an object store."""
    wanted = two.newest()
    two.commit(MapState.new(2, {**wanted.document, "method": "late"}, wanted.arrays, 1, 1))
    assert two.versions() == [1, 2]
    for state in (two.newest(), two.state(2), two.states()[-1]):
        assert state.document == wanted.document
        assert (state.frames_version, state.descriptors_version) == (
            wanted.frames_version,
            wanted.descriptors_version,
        )


def test_frames_that_another_writer_added_are_noticed(two: MapTables) -> None:
    frames = two.add_frames(rows("late", 4))
    two.require_alone(frames, 12)
    for expected in (8, 11, 13):
        with pytest.raises(MapError, match="another process changed the map .* meanwhile, so this change came to noth"):
            two.require_alone(frames, expected)
