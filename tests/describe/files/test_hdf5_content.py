"""Damaged files that libhdf5 crashes on, reads for ever, or takes all memory for."""

from __future__ import annotations

import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from everplace import child_process
from everplace.describe.files.descriptors import Descriptors, load_descriptors
from everplace.errors import DescriptorsError

DAMAGED = Path(__file__).with_name("damaged_hdf5.zip")
"""Files of twelve frames in either layout, in each of which one byte (`crashes_too`: three) was changed."""


def unpacked(name: str, directory: Path) -> Path:
    with zipfile.ZipFile(DAMAGED) as archive:
        return Path(archive.extract(name, directory))


@pytest.mark.parametrize("name", ["crashes.h5", "crashes_too.h5", "crashes_hloc.h5"])
def test_a_file_that_libhdf5_crashes_on_is_named(tmp_path: Path, name: str) -> None:
    path = unpacked(name, tmp_path)
    with pytest.raises(DescriptorsError, match=rf"{name} is no readable HDF5 file \(reading it ended with SIGSEGV\)"):
        load_descriptors(path)


@pytest.mark.parametrize("name", ["loops.h5", "loops_hloc.h5"])
def test_a_file_that_libhdf5_reads_for_ever_is_named(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "_SECONDS", 2.0)
    path = unpacked(name, tmp_path)
    with pytest.raises(DescriptorsError, match=rf"{name} is no readable HDF5 file \(reading it came to no end\)"):
        load_descriptors(path)


@pytest.mark.parametrize("name", ["allocates.h5", "allocates_hloc.h5"])
def test_a_file_that_asks_for_gigabytes_is_named(tmp_path: Path, name: str) -> None:
    path = unpacked(name, tmp_path)
    with pytest.raises(DescriptorsError, match=rf"{name} is no readable HDF5 file \(.*memory"):
        load_descriptors(path)


@pytest.mark.parametrize("chunks", [None, (100, 64), (70, 30), (1000, 1)])
def test_blocks_are_put_together_as_they_were(tmp_path: Path, chunks: tuple[int, int] | None) -> None:
    values = np.random.default_rng(0).normal(size=(80_000, 64)).astype(np.float32)  # more than one block
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file.create_dataset("descriptors", data=values, chunks=chunks)
        file["names"] = [str(number) for number in range(len(values))]
    assert np.array_equal(load_descriptors(tmp_path / "d.h5").values, values)


def test_a_module_in_the_working_directory_is_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Descriptors(np.ones((1, 2), np.float32), ("a",), "test").save(tmp_path / "d.h5")
    (tmp_path / "json.py").write_text("raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    assert load_descriptors(Path("d.h5")).names == ("a",)
