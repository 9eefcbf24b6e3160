"""hloc's layout: read as hloc reads it, and back as it was; foreign files of it, and damaged ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from everplace.describe.files.descriptors import Descriptors, load_descriptors
from everplace.errors import DescriptorsError

VALUES = np.arange(6, dtype=np.float32).reshape(3, 2)
NAMES = ("9", "10", "11")
IMAGES = ("9.png", "10.JPG", "11.png")


def example(**others: Any) -> Descriptors:
    fields: dict[str, Any] = {"values": VALUES, "names": NAMES, "method": "test", "image_names": IMAGES}
    return Descriptors(**{**fields, **others})


def listed_by_hloc(path: Path) -> set[str]:
    """What hloc takes for the images of a file of features: the parents of all its datasets."""
    found = []
    with h5py.File(path, "r", libver="latest") as file:
        file.visititems(lambda _, item: found.append(item.parent.name.strip("/")) if hasattr(item, "dtype") else None)
    return set(found)


def test_it_is_a_group_an_image(tmp_path: Path) -> None:
    example().write_hloc(tmp_path / "d.h5")
    assert listed_by_hloc(tmp_path / "d.h5") == set(IMAGES)
    with h5py.File(tmp_path / "d.h5", "r") as file:
        for image, row in zip(IMAGES, VALUES, strict=True):
            assert file[image]["global_descriptor"].dtype == np.float32
            assert file[image]["global_descriptor"].__array__().tolist() == row.tolist()


def test_it_is_read_back_in_the_natural_order_of_the_names(tmp_path: Path) -> None:
    example(metric="mean-absolute-difference", settings={"cell": 8}).write_hloc(tmp_path / "d.h5")
    read = load_descriptors(tmp_path / "d.h5")
    assert (read.names, read.image_names) == (NAMES, IMAGES)
    assert read.values.tolist() == VALUES.tolist()
    assert (read.method, read.metric, read.settings) == ("test", "mean-absolute-difference", {"cell": 8})


def test_without_image_names_the_groups_are_the_names(tmp_path: Path) -> None:
    names = ("1.25", "1.5", "Fähre/b")
    example(names=names, image_names=None).write_hloc(tmp_path / "d.h5")
    assert listed_by_hloc(tmp_path / "d.h5") == set(names)
    assert load_descriptors(tmp_path / "d.h5").names == names


def test_hlocs_own_files_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "d.h5", "w") as file:
        for number, image in enumerate(["query/night/7.jpg", "db/10.jpg", "db/9.jpg", "names/1.png"]):
            group = file.create_group(image)
            group["global_descriptor"] = np.full(3, number, np.float16)
            group["keypoints"] = np.zeros((5, 2), np.float32)
            group["global_descriptor"].attrs["uncertainty"] = 0.5
        file.create_group("db/no-descriptor.jpg")["keypoints"] = np.zeros((5, 2), np.float32)
    read = load_descriptors(tmp_path / "d.h5")
    # The names are the stems that `everplace data import hloc` gives the images.
    assert read.names == ("db-9", "db-10", "names-1", "query-night-7")
    assert read.image_names == ("db/9.jpg", "db/10.jpg", "names/1.png", "query/night/7.jpg")
    assert read.values.tolist() == [[2] * 3, [1] * 3, [3] * 3, [0] * 3]
    assert (read.method, read.metric, read.settings) == ("unknown", "cosine", {})


@pytest.mark.parametrize("name", ["/a", "a/", "a//b", "./a", ".", "global_descriptor/a", "Fähre", "b\udcff"])
def test_names_that_are_no_group_are_refused(tmp_path: Path, name: str) -> None:
    for fields in ({"image_names": ("a", "Fähre/b", name)}, {"names": ("a", "Fähre/b", name), "image_names": None}):
        with pytest.raises(DescriptorsError, match="cannot name a group in hloc's layout"):
            example(**fields).write_hloc(tmp_path / "d.h5")
    assert list(tmp_path.iterdir()) == []


def test_links_lead_nowhere(tmp_path: Path) -> None:
    example().write_hloc(tmp_path / "other.h5")
    example().write_hloc(tmp_path / "d.h5")
    with h5py.File(tmp_path / "d.h5", "r+") as file:
        file.create_group("round")["again"] = file["/"]
        file["soft.png"] = h5py.SoftLink("/9.png")
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/")
    assert load_descriptors(tmp_path / "d.h5").image_names == IMAGES


def _put(file: h5py.File, value: Any) -> None:
    file["12.png/global_descriptor"] = value


def _elsewhere(file: h5py.File) -> None:
    path = Path(file.filename).with_name("secret")
    path.write_bytes(VALUES.tobytes())
    file.create_dataset("12.png/global_descriptor", (2,), np.float32, external=[(str(path), 0, 8)])


def _empty(file: h5py.File) -> None:
    file.clear()


def _local_features(file: h5py.File) -> None:
    file.clear()
    file["9.png/descriptors"] = VALUES


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda file: _put(file, np.ones(3, np.float32)), "'12.png' has 3 numbers and that of '10.JPG' 2"),
        (lambda file: _put(file, np.ones(2, np.int64)), "`12.png/global_descriptor` must be D floating.* not int64"),
        (lambda file: _put(file, np.ones((1, 2), np.float32)), r"not float32 of \(1, 2\)"),
        (lambda file: _put(file, np.array([1, np.nan], np.float32)), "frame '12' holds NaN"),
        (lambda file: file.create_dataset("12.png/global_descriptor", (1 << 40,), np.float32), "holds only 0 bytes"),
        (_elsewhere, "`12.png/global_descriptor` keeps its numbers in other files"),
        (lambda file: file.move("11.png", "9.jpg"), "the images '9.jpg' and '9.png' have one stem"),
        (_empty, "neither datasets `descriptors` and `names` nor a group for each image with `global_descriptor`"),
        (_local_features, "neither datasets `descriptors` and `names` nor"),
    ],
)
def test_a_malformed_file_is_named_with_its_fault(
    tmp_path: Path, damage: Callable[[h5py.File], object], message: str
) -> None:
    path = tmp_path / "d.h5"
    example().write_hloc(path)
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(DescriptorsError, match=rf"d\.h5 cannot be read: .*{message}"):
        load_descriptors(path)
