"""Files that are written while they are described: equal to those of descriptors in memory, and whole or not there."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.describe.test_describer import MeanColour, Undecided, drive_of
from tests.forked import ForkedProcess
from tests.importing.sources.test_video import write_video

from everplace.choices import DescriptorFormat
from everplace.describe.described_file import describe_to_file
from everplace.describe.files.descriptors import Descriptors, load_descriptors
from everplace.describe.recorded_frames import open_recording
from everplace.errors import DescriptorsError

LAYOUTS: Sequence[DescriptorFormat] = ("everplace", "hloc")


class Long(MeanColour):
    """So many numbers that few rows fill a block."""

    dimension = 3 * 2**15

    def describe_batch(self, images: NDArray[np.uint8]) -> NDArray[np.float32]:
        return np.repeat(super().describe_batch(images), 2**15, axis=1)


def equal(first: Descriptors, second: Descriptors) -> None:
    np.testing.assert_array_equal(first.values, second.values)
    for name in ("names", "image_names", "method", "metric", "settings"):
        assert getattr(first, name) == getattr(second, name)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("describer", [MeanColour(), Long()])
@pytest.mark.parametrize("directory", ["", "day/front"])
def test_the_file_is_that_of_descriptors_in_memory(
    tmp_path: Path, layout: DescriptorFormat, describer: MeanColour, directory: str
) -> None:
    traverse = drive_of(tmp_path / "drive", [3, 1, 4, 15, 9, 2, 6])
    assert describe_to_file(describer, traverse, tmp_path / "a.h5", layout=layout, directory=directory, batch=3) == 7
    described = describer.describe(traverse)
    described = described.under(directory) if directory else described
    (described.write_hloc if layout == "hloc" else described.save)(tmp_path / "b.h5")
    equal(load_descriptors(tmp_path / "a.h5"), load_descriptors(tmp_path / "b.h5"))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_frames_of_a_recording_are_named_as_they_pass(tmp_path: Path, layout: DescriptorFormat) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    write_video(tmp_path / "a.mkv", 12)
    assert describe_to_file(MeanColour(), open_recording(tmp_path / "a.mkv"), tmp_path / "a.h5", layout=layout) == 12
    found, wanted = load_descriptors(tmp_path / "a.h5"), MeanColour().describe(open_recording(tmp_path / "a.mkv"))
    assert found.names == wanted.names
    np.testing.assert_array_equal(found.values, wanted.values)


def test_no_chunk_of_the_file_is_mostly_empty(tmp_path: Path) -> None:
    describe_to_file(Long(), drive_of(tmp_path / "drive", range(9)), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        stored, rows = file["descriptors"].id.get_storage_size(), file["descriptors"].chunks[0]
    assert stored <= (9 + rows) * Long.dimension * 4
    assert rows == 2  # 768 KiB


@pytest.mark.parametrize("layout", LAYOUTS)
def test_equal_descriptors_are_warned_of(tmp_path: Path, layout: DescriptorFormat) -> None:
    drive = drive_of(tmp_path / "drive", [7, 0, 7, 9, 7])
    with pytest.warns(UserWarning, match="3 of the 5 descriptors of .*drive are equal"):
        describe_to_file(MeanColour(), drive, tmp_path / "a.h5", layout=layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_number_that_is_not_finite_leaves_no_file(tmp_path: Path, layout: DescriptorFormat) -> None:
    with pytest.raises(DescriptorsError, match="'2' holds NaN"):
        describe_to_file(
            Undecided(), drive_of(tmp_path / "drive", [1, 2, 7, 4]), tmp_path / "out" / "a.h5", layout=layout
        )
    assert list((tmp_path / "out").iterdir()) == []


FULL = """
import resource, sys
from pathlib import Path
from tests.describe.test_described_file import Long
from everplace.describe.described_file import describe_to_file
from everplace.errors import StorageError
from everplace.route.folder import open_traverse

resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
describer = Long()
try:
    describe_to_file(describer, open_traverse(Path(sys.argv[1])), Path(sys.argv[2]), layout=sys.argv[3], batch=1)
except StorageError as error:
    print(error)
    print(len(describer.batches))
"""


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_full_disk_is_one_error_at_once_and_leaves_nothing(tmp_path: Path, layout: DescriptorFormat) -> None:
    drive = drive_of(tmp_path / "drive", range(60))
    out = tmp_path / "out" / "a.h5"
    process = ForkedProcess("-c", FULL, drive.root, out, layout, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    told, err = process.communicate()
    assert (process.returncode, err) == (0, "")
    said, described = told.splitlines()
    assert said.startswith(f"cannot write {out}: File too large")
    assert int(described) < 20  # of 60: 2 MB hold 5
    assert list(out.parent.iterdir()) == []
