"""Descriptors: what they refuse, and that files give everything back or say what is wrong."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from tests.forked import ForkedProcess

from everplace.describe.files.descriptors import Descriptors, load_descriptors
from everplace.errors import DescriptorsError, StorageError

VALUES = np.arange(6, dtype=np.float32).reshape(3, 2)
NAMES = ("a", "Fähre/b", "c")


def example(**others: Any) -> Descriptors:
    fields: dict[str, Any] = {"values": VALUES, "names": NAMES, "method": "test"}
    return Descriptors(**{**fields, **others})


def test_a_file_gives_everything_back(tmp_path: Path) -> None:
    path = tmp_path / "new" / "d.h5"
    settings = {"word": "ü", "cell": 8, "rate": 0.1, "on": True}
    example(metric="mean-absolute-difference", settings=settings).save(path)
    read = load_descriptors(path)
    assert read.values.dtype == np.float32
    assert (read.values == VALUES).all()
    assert (read.names, read.method, read.metric) == (NAMES, "test", "mean-absolute-difference")
    assert read.settings == settings
    assert read.settings["on"] is True
    assert (len(read), read.dimension) == (3, 2)


def test_rows_by_name() -> None:
    whole = example(settings={"cell": 8})
    some = whole.of(["c", "a"])
    assert some.names == ("c", "a")
    np.testing.assert_array_equal(some.values, VALUES[[2, 0]])
    assert (some.method, some.settings) == ("test", {"cell": 8})
    assert whole.of(NAMES) is whole
    with pytest.raises(DescriptorsError, match="no descriptor of the frame 'd'"):
        whole.of(["a", "d"])


def test_rows_by_position() -> None:
    image_names = ("a.png", "b.png", "c.png")
    whole = example(settings={"cell": 8}, image_names=image_names)
    for frames in ([2, 1], slice(2, 0, -1)):
        some = whole.take(frames)
        assert (some.names, some.image_names) == (("c", "Fähre/b"), ("c.png", "b.png"))
        np.testing.assert_array_equal(some.values, VALUES[[2, 1]])
        assert (some.method, some.settings) == ("test", {"cell": 8})


def test_the_file_is_the_one_of_the_contract(tmp_path: Path) -> None:
    example(settings={"cell": 8}).save(str(tmp_path / "d.h5"))
    with h5py.File(tmp_path / "d.h5", "r") as file:
        assert sorted(file) == ["descriptors", "names"]
        assert file["descriptors"].dtype == np.float32
        string = h5py.check_string_dtype(file["names"].dtype)
        assert string is not None
        assert (string.encoding, string.length) == ("utf-8", None)
        assert list(file["names"].asstr()) == list(NAMES)
        assert sorted(file.attrs) == ["everplace_version", "method", "metric", "settings"]
        assert file.attrs["settings"] == '{"cell": 8}'


def test_the_names_of_the_image_files_stand_beside_the_names(tmp_path: Path) -> None:
    image_names = ("a.png", "Fähre/b.JPG", "c\udcff.png")
    example(image_names=image_names).save(tmp_path / "d.h5")
    with h5py.File(tmp_path / "d.h5", "r") as file:
        assert sorted(file) == ["descriptors", "image_names", "names"]
        assert list(file["names"].asstr()) == list(NAMES)
    read = load_descriptors(tmp_path / "d.h5")
    assert (read.names, read.image_names) == (NAMES, image_names)
    assert read.of(["c", "a"]).image_names == ("c\udcff.png", "a.png")


def test_a_file_without_the_names_of_the_image_files_is_read(tmp_path: Path) -> None:
    example().save(tmp_path / "d.h5")
    assert load_descriptors(tmp_path / "d.h5").image_names is None
    assert example().of(["c"]).image_names is None


def test_a_file_of_an_earlier_release_may_hold_a_variance(tmp_path: Path) -> None:
    example(settings={"cell": 8}).save(tmp_path / "d.h5")
    with h5py.File(tmp_path / "d.h5", "r+") as file:
        file["variance"] = VALUES + 1
    read = load_descriptors(tmp_path / "d.h5")
    assert (read.values == VALUES).all()
    assert (read.names, read.settings) == (NAMES, {"cell": 8})


def test_names_that_are_not_utf8_keep_their_bytes(tmp_path: Path) -> None:
    names = ("a", "b\udcff", "c")
    example(names=names).save(tmp_path / "d.h5")
    assert load_descriptors(tmp_path / "d.h5").names == names


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_names_its_frame(bad: float) -> None:
    array = VALUES.copy()
    array[1, 0] = bad
    with pytest.raises(DescriptorsError, match="frame 'Fähre/b' holds NaN or infinity"):
        example(values=array)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"values": VALUES.astype(object)}, "not object"),
        ({"values": VALUES.astype(np.int64)}, "not int64"),
        ({"values": VALUES[0]}, r"not of shape \(2,\)"),
        ({"values": VALUES[:0], "names": ()}, r"at least one frame"),
        ({"values": VALUES[:, :0]}, r"not of shape \(3, 0\)"),
        ({"values": VALUES[:2]}, "2 rows of descriptors for 3 names"),
        ({"values": np.full((3, 2), 1e300)}, "frame 'a' holds NaN or infinity"),
        ({"names": ("a", "b", "a")}, "'a' occurs twice"),
        ({"names": ("a", "b", "")}, "cannot name a frame"),
        ({"names": ("a", "b", "c\0d")}, "cannot name a frame"),
        ({"names": ("a", "b", "c\ud800")}, "cannot name a frame"),
        ({"metric": "euclid"}, "cosine, mean-absolute-difference, place-posterior, not 'euclid'"),
        ({"image_names": ("a.png", "b.png")}, "2 image names for 3 names"),
        ({"image_names": ("a.png", "b.png", "a.png")}, "'a.png' occurs twice"),
        ({"image_names": ("a.png", "b.png", "")}, "cannot name a frame"),
    ],
)
def test_parts_that_do_not_fit_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(DescriptorsError, match=message):
        example(**fields)


def test_float32_is_kept_without_a_copy_and_float64_is_converted() -> None:
    assert example().values is VALUES
    converted = example(values=VALUES.astype(np.float64)).values
    assert converted.dtype == np.float32
    assert (converted == VALUES).all()


def _object(file: h5py.File) -> None:
    del file["descriptors"]
    file.create_dataset("descriptors", data=["x", "y"], dtype=h5py.string_dtype())


def _integers(file: h5py.File) -> None:
    del file["descriptors"]
    file["descriptors"] = VALUES.astype(np.int32)


def _one_row(file: h5py.File) -> None:
    del file["descriptors"]
    file["descriptors"] = VALUES[0]


def _nothing_behind_it(file: h5py.File) -> None:
    del file["descriptors"]
    file.create_dataset("descriptors", shape=(1 << 40, 1 << 10), dtype=np.float32, chunks=(1024, 1024))


def _one_chunk_of_many(file: h5py.File) -> None:
    del file["descriptors"]
    sparse = file.create_dataset("descriptors", shape=(3, 1 << 40), dtype=np.float32, chunks=(1, 64))
    sparse[0, :2] = 1


def _zip_bomb(file: h5py.File) -> None:
    del file["descriptors"]
    shape, chunks = (3, 1 << 30), (1, 1 << 20)
    packed = file.create_dataset("descriptors", shape, np.float32, chunks=chunks, compression="gzip")
    packed[0, :2] = 1


def _more_chunk_than_numbers(file: h5py.File) -> None:
    del file["descriptors"]
    shape, chunks = (3, 2), (3, 1 << 22)
    file.create_dataset(
        "descriptors", shape, np.float32, data=VALUES, chunks=chunks, maxshape=(3, None), compression="gzip"
    )


def _bytes_of_another_file(file: h5py.File) -> None:
    del file["descriptors"]
    path = Path(file.filename).with_name("secret")
    path.write_bytes(VALUES.tobytes())
    file.create_dataset("descriptors", (3, 2), np.float32, external=[(str(path), 0, h5py.h5f.UNLIMITED)])


def _virtual(file: h5py.File) -> None:
    del file["descriptors"]
    with h5py.File(Path(file.filename).with_name("other.h5"), "w") as other:
        other["x"] = VALUES
        layout = h5py.VirtualLayout((3, 2), np.float32)
        layout[:] = h5py.VirtualSource(other["x"])
    file.create_virtual_dataset("descriptors", layout)


def _external_link(file: h5py.File) -> None:
    del file["names"]
    with h5py.File(Path(file.filename).with_name("other.h5"), "w") as other:
        other["names"] = list(NAMES)
    file["names"] = h5py.ExternalLink("other.h5", "names")


def _soft_link(file: h5py.File) -> None:
    file.move("names", "others")
    file["names"] = h5py.SoftLink("/others")


def _more_names(file: h5py.File) -> None:
    del file["names"]
    file["names"] = [*NAMES, "d"]


def _null(file: h5py.File) -> None:
    del file["descriptors"]
    file["descriptors"] = h5py.Empty("f4")


def _group(file: h5py.File) -> None:
    del file["descriptors"]
    file.create_group("descriptors")


def _no_names(file: h5py.File) -> None:
    del file["names"]


def _number_image_names(file: h5py.File) -> None:
    file["image_names"] = np.arange(3)


def _fewer_image_names(file: h5py.File) -> None:
    file["image_names"] = ["a.png"]


def _number_names(file: h5py.File) -> None:
    del file["names"]
    file["names"] = np.arange(3)


def _nan(file: h5py.File) -> None:
    file["descriptors"][1, 0] = np.nan


def _method(file: h5py.File) -> None:
    file.attrs["method"] = 3


def _metric(file: h5py.File) -> None:
    file.attrs["metric"] = "euclid"


def _settings(file: h5py.File) -> None:
    file.attrs["settings"] = "{"


def _settings_list(file: h5py.File) -> None:
    file.attrs["settings"] = "[1]"


def _settings_nested(file: h5py.File) -> None:
    file.attrs["settings"] = '{"a": {}}'


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_object, "floating-point numbers, not object"),
        (_integers, "floating-point numbers, not int32"),
        (_one_row, r"not float32 of \(2,\)"),
        (_nothing_behind_it, "holds only 0 bytes"),
        (_one_chunk_of_many, r"announces the shape \(3, 1099511627776\), but holds only 256 bytes"),
        (_zip_bomb, "announces the shape"),
        (_more_chunk_than_numbers, "announces the shape"),
        (_bytes_of_another_file, "`descriptors` keeps its numbers in other files"),
        (_virtual, "`descriptors` keeps its numbers in other files"),
        (_external_link, "`names` is a link to another place"),
        (_soft_link, "`names` is a link to another place"),
        (_more_names, "3 rows of descriptors for 4 names"),
        (_null, "floating-point numbers, not float32 of None"),
        (_group, "no dataset `descriptors`"),
        (_no_names, "no dataset `names`"),
        (_number_names, "`names` must be a list of strings"),
        (_number_image_names, "`image_names` must be a list of strings"),
        (_fewer_image_names, "1 image names for 3 names"),
        (_nan, "frame 'Fähre/b' holds NaN"),
        (_method, "attribute `method` must be text"),
        (_metric, "not 'euclid'"),
        (_settings, "`settings` is no JSON"),
        (_settings_list, "`settings` must be a JSON object"),
        (_settings_nested, "`settings` must be a JSON object"),
    ],
)
def test_a_malformed_file_is_named_with_its_fault(
    tmp_path: Path, damage: Callable[[h5py.File], None], message: str
) -> None:
    path = tmp_path / "d.h5"
    example().save(path)
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(DescriptorsError, match=rf"d\.h5.*{message}"):
        load_descriptors(path)


def test_a_file_that_is_missing_cut_short_or_no_hdf5_is_named(tmp_path: Path) -> None:
    path = tmp_path / "d.h5"
    with pytest.raises(DescriptorsError, match=r"there is no descriptor file .*d\.h5"):
        load_descriptors(path)
    with pytest.raises(DescriptorsError, match="there is no descriptor file"):
        load_descriptors(tmp_path)
    example().save(path)
    whole = path.read_bytes()
    for content in (b"", b"PK\x03\x04", whole[: len(whole) // 2]):
        path.write_bytes(content)
        with pytest.raises(DescriptorsError, match=r"d\.h5 is no readable HDF5 file"):
            load_descriptors(path)


def test_a_file_from_elsewhere_needs_values_and_names_only(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["descriptors"] = VALUES.astype(np.float16)
        file["names"] = np.array([b"a", b"b", b"c"])
    read = load_descriptors(tmp_path / "d.h5")
    assert (read.names, read.method, read.metric, read.settings) == (("a", "b", "c"), "unknown", "cosine", {})
    assert read.values.dtype == np.float32


def test_a_compressed_file_from_elsewhere_is_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).random((300, 16), np.float32)
    names = tuple(f"frame {number}" for number in range(300))
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file.create_dataset("descriptors", data=values, compression="gzip", maxshape=(None, 16))
        file.create_dataset("names", data=names, dtype=h5py.string_dtype(), compression="gzip", maxshape=(None,))
    read = load_descriptors(tmp_path / "d.h5")
    assert (read.values == values).all()
    assert read.names == names


def test_names_that_all_point_at_one_long_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "d.h5"
    text = b"x" * 60_000
    many = np.ones((5000, 1), np.float32)
    names = tuple(f"{number}" for number in range(len(many)))
    example(values=many, names=names).save(path)
    with h5py.File(path, "r+") as file:
        del file["names"]
        file.create_dataset("names", (len(many),), h5py.string_dtype())[0] = text
        start = file["names"].id.get_offset()
    # A string is its length, the address of a heap and a number in it: copied, it is the same text again.
    data = bytearray(path.read_bytes())
    data[start : start + 16 * len(many)] = bytes(data[start : start + 16]) * len(many)
    path.write_bytes(data)
    with pytest.raises(DescriptorsError, match=r"d\.h5 cannot be read: its `names` are longer than the file"):
        load_descriptors(path)


def test_a_write_that_fails_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError):
        example().save(tmp_path / "file" / "d.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


FULL_DISK = """
import resource, sys
import numpy as np
from everplace.describe.files.descriptors import Descriptors
from everplace.errors import StorageError

names = tuple(f"frame {number}" for number in range(40))
descriptors = Descriptors(np.ones((40, 256), np.float32), names, method="test")
for limit in (0, 1, 500, 2000, 8192, 40_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    for write in (descriptors.save, descriptors.write_hloc):
        try:
            write(sys.argv[1])
        except StorageError as error:
            print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
def test_a_disk_that_fills_is_told_and_nothing_is_left(tmp_path: Path) -> None:
    process = ForkedProcess("-c", FULL_DISK, tmp_path / "d.h5", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out, err = process.communicate()
    assert (process.returncode, err) == (0, "")
    assert out.count("cannot write") == len(out.splitlines()) == 12
    assert list(tmp_path.iterdir()) == []
