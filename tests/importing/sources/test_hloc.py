"""hloc's lists of pairs and HDF5 files of features."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fuzzing import fuzzed
from tests.importing.packing import pack

from everplace import child_process
from everplace.errors import RouteError
from everplace.importing.containers.file_trees import TreePath
from everplace.importing.sources import hloc
from everplace.route.selection import Selection
from everplace.scoring.retrieval import MatchRule, choose_pair, true_matches


def features(data_set: Any, name: str, images: list[str]) -> None:
    with h5py.File(data_set.root / name, "w") as file:
        for image in images:
            file.create_group(image)["keypoints"] = np.zeros((2, 2), np.float32)


def test_pairs_become_two_traverses_and_their_truth(data_set: Any) -> None:
    data_set.images(".", ["db/1.jpg", "db/2.jpg", "query/night/1.jpg", "query/night/2.jpg"])
    data_set.text("pairs.txt", ["# made by hand", "query/night/1.jpg db/2.jpg", "query/night/2.jpg db/1.jpg"])
    route = data_set.imported("hloc")
    assert route.truth_origin == "the pairs of pairs.txt"
    assert route["queries"].stems == ("query-night-1", "query-night-2")
    assert route["database"].stems == ("db-1", "db-2")
    pair = choose_pair(route, "queries", "database", Selection())
    assert true_matches(pair, MatchRule())[0].astype(int).tolist() == [[0, 1], [1, 0]]


def test_hdf5_lists_name_images_without_a_pair(data_set: Any) -> None:
    data_set.images("images", ["db/1.jpg", "db/2.jpg", "db/3.jpg", "q.jpg", "r.jpg"])
    data_set.text("truth/pairs.txt", ["q.jpg db/2.jpg"])
    features(data_set, "feats.h5", ["db/1.jpg", "db/2.jpg", "db/3.jpg"])
    data_set.text("queries.txt", ["q.jpg PINHOLE 640 480 1 1 1 1", "r.jpg PINHOLE 640 480 1 1 1 1"])
    options = {"pairs": "truth/pairs.txt", "images": "images", "queries": "queries.txt", "database": "feats.h5"}
    frames = data_set.frames(hloc, **options)
    assert {side: [frame.stem for frame in found] for side, found in frames.items()} == {
        "queries": ["q", "r"], "database": ["db-1", "db-2", "db-3"],
    }  # fmt: skip
    assert len(data_set.pairs(hloc, **options)) == 1


def test_the_layout_of_everplace_describe(data_set: Any) -> None:
    data_set.text("pairs.txt", ["q.jpg a.jpg"])
    with h5py.File(data_set.root / "d.h5", "w") as file:
        file["descriptors"] = np.zeros((2, 3), np.float32)
        file.create_dataset("names", data=["a", "b"], dtype=h5py.string_dtype())
        file.create_dataset("image_names", data=["a.jpg", "b.jpg"], dtype=h5py.string_dtype())
    assert hloc._read_hdf5(TreePath(data_set.root / "d.h5")) == ["a.jpg", "b.jpg"]


def test_the_layout_that_others_write_has_names_alone(data_set: Any) -> None:
    with h5py.File(data_set.root / "d.h5", "w") as file:
        file["descriptors"] = np.zeros((2, 3), np.float32)
        file.create_dataset("names", data=["a.jpg", "b.jpg"], dtype=h5py.string_dtype())
    assert hloc._read_hdf5(TreePath(data_set.root / "d.h5")) == ["a.jpg", "b.jpg"]


def test_pairs_within_one_set_are_one_traverse(data_set: Any) -> None:
    data_set.images(".", ["a.jpg", "b.jpg", "c.jpg"])
    data_set.text("pairs.txt", ["a.jpg b.jpg", "b.jpg c.jpg"])
    assert [frame.stem for frame in data_set.frames(hloc)["images"]] == ["a", "b", "c"]
    assert data_set.pairs(hloc)[1] == ("images", "b", "images", "c")
    route = data_set.imported("hloc")
    pair = choose_pair(route, "images", "images", Selection())
    expected = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], dtype=bool)
    np.testing.assert_array_equal(true_matches(pair, MatchRule())[0], expected)


def test_links_in_a_file_lead_nowhere(data_set: Any) -> None:
    with h5py.File(data_set.root / "f.h5", "w") as file:
        file.create_group("a.jpg")
        file["round"] = h5py.SoftLink("/")
        file.create_group("b/c.jpg")
        file["b/c.jpg/again"] = file["b"]
        file["out"] = h5py.ExternalLink("/etc/passwd", "/")
    assert hloc._read_hdf5(TreePath(data_set.root / "f.h5")) == ["a.jpg", "b/c.jpg"]


@pytest.mark.parametrize(
    ("lines", "options", "message"),
    [
        ([], {}, r"pairs\.txt names no pair"),
        (["q.jpg"], {}, r"pairs\.txt, line 1 holds one name"),
        (["q.jpg ../../etc/passwd"], {}, "line 1 names the file '../../etc/passwd', which is not inside"),
        (["q.jpg /etc/passwd"], {}, "is not inside the data set"),
        (["q.jpg a.jpg", "q.jpg z.jpg"], {"database": "list.txt"}, r"names 'z\.jpg', which .*list\.txt does not"),
        (["q.jpg a.jpg"], {"database": "pairs.h5"}, r"pairs\.h5 is not a readable HDF5 file"),
        (["q.jpg a.jpg"], {"pairs": "gone.txt"}, r"cannot read .*gone\.txt"),
    ],
)
def test_wrong_lists_are_named(data_set: Any, lines: list[str], options: dict[str, str], message: str) -> None:
    data_set.text("pairs.txt", lines)
    data_set.text("list.txt", ["a.jpg"])
    data_set.text("pairs.h5", ["no HDF5"])
    with pytest.raises(RouteError, match=message) as caught:
        data_set.read(hloc, **options)
    assert "\n" not in str(caught.value)


def test_an_image_that_is_not_there(data_set: Any) -> None:
    data_set.text("pairs.txt", ["q.jpg a.jpg"])
    with pytest.raises(RouteError, match=r"q\.jpg does not exist, but .*pairs\.txt or a list of images names it"):
        data_set.frames(hloc)


@given(st.binary(max_size=80))
@fuzzed(80)
def test_any_bytes_are_pairs_or_one_error(data_set: Any, content: bytes) -> None:
    (data_set.root / "pairs.txt").write_bytes(content)
    try:
        route = data_set.read(hloc)
    except RouteError as error:
        assert "\n" not in str(error)
    else:
        assert list(route.truth)


@pytest.mark.parametrize("archived", [False, True])
@pytest.mark.parametrize("signal", ["SIGSEGV", "SIGBUS", "SIGABRT"])
def test_a_file_that_crashes_its_reader_is_one_sentence(
    data_set: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, signal: str, archived: bool
) -> None:
    # What a damaged file does to libhdf5, done on purpose
    (tmp_path / "h5py.py").write_text(f"import os, signal\nos.kill(os.getpid(), signal.{signal})\n")
    monkeypatch.syspath_prepend(tmp_path)
    data_set.images(".", ["q.jpg", "a.jpg"])
    data_set.text("pairs.txt", ["q.jpg a.jpg"])
    features(data_set, "f.h5", ["a.jpg"])
    source = pack(data_set.root, tmp_path / "set.zip") if archived else data_set.root
    with pytest.raises(RouteError, match=rf"f\.h5 is not a readable HDF5 file \(reading it ended with {signal}\)"):
        hloc.read(source, hloc.Options(database="f.h5"))


@pytest.mark.parametrize(
    ("name", "reason"), [("loops.h5", "reading it came to no end"), ("allocates.h5", ".*memory allocation failed.*")]
)
def test_a_file_that_libhdf5_does_not_get_through_is_one_sentence(
    data_set: Any, monkeypatch: pytest.MonkeyPatch, name: str, reason: str
) -> None:
    monkeypatch.setattr(child_process, "_SECONDS", 3.0)
    data_set.text("pairs.txt", ["q.jpg a.jpg"])
    with zipfile.ZipFile(Path(__file__).parents[2] / "describe/files/damaged_hdf5.zip") as archive:
        archive.extract(name, data_set.root)
    with pytest.raises(RouteError, match=rf"{name} is not a readable HDF5 file \({reason}\)"):
        hloc.read(data_set.root, hloc.Options(database=name))
