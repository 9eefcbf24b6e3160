"""A pointer of Git LFS in place of a file is called one, whatever the file should have been."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from everplace.describe.files.descriptors import load_descriptors
from everplace.errors import EverplaceError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.importing.import_route import import_route
from everplace.route.csv_table import CsvTable
from everplace.tensor_file import load_tensors

POINTER = (
    "version https://git-lfs.github.com/spec/v1\n"
    "oid sha256:4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 12345\n"
)


def refused(call: Callable[[], object], name: str) -> None:
    with pytest.raises(EverplaceError) as caught:
        call()
    assert str(caught.value).count("Git LFS pointer") == 1
    assert name in str(caught.value)
    assert "`git lfs pull`" in str(caught.value)


def pointer(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(POINTER)
    return path


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tiff", "a.heic"])
def test_images(tmp_path: Path, name: str) -> None:
    refused(lambda: decode_image(pointer(tmp_path / "day" / name), ImageSpec()), name)
    refused(lambda: import_route("images", tmp_path / "day", tmp_path / "out"), name)
    refused(lambda: import_route("images", tmp_path / "day", tmp_path / "out", {"size": "8x8"}), name)


@pytest.mark.parametrize(
    ("kind", "name", "needs"),
    [
        ("video", "winter.mp4", "av"),
        ("bag", "winter.bag", "rosbags"),
        ("bag", "winter.mcap", "rosbags"),
        ("nordland", "winter.tar.gz", ""),
        ("tum", "desk.tgz", ""),
        ("vprbench", "corridor.zip", ""),
        ("kaist", "videos/set00/Visible_V000.seq", ""),
        ("nordland", "0000.parquet", "pyarrow"),
    ],
)
def test_recordings_and_archives(tmp_path: Path, kind: str, name: str, needs: str) -> None:
    if needs:
        pytest.importorskip(needs)
    pointer(tmp_path / "data" / name)
    source = tmp_path / "data" if "/" in name or name.endswith((".parquet", ".tgz")) else tmp_path / "data" / name
    refused(lambda: import_route(kind, source, tmp_path / "out"), Path(name).name)


def test_a_bag_of_ros_2(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pointer(tmp_path / "drive" / "drive_0.db3")
    (tmp_path / "drive/metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    refused(lambda: import_route("bag", tmp_path / "drive", tmp_path / "out"), "drive_0.db3")


def test_descriptors_and_numbers(tmp_path: Path) -> None:
    refused(lambda: load_descriptors(pointer(tmp_path / "a.h5")), "a.h5")
    refused(lambda: CsvTable(pointer(tmp_path / "poses.csv")), "poses.csv")
    file = pointer(tmp_path / "c-0123456789abcdef.safetensors").name
    document = {"format": 1, "tensors": {"file": file, "sha256": "0" * 64}}
    (tmp_path / "c.json").write_text(json.dumps(document))
    refused(lambda: load_tensors(tmp_path, "c", 1), file)


def test_lists_and_truths_of_data_sets(tmp_path: Path) -> None:
    for folder in ("query", "ref"):
        (tmp_path / "bench" / folder).mkdir(parents=True)
        Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "bench" / folder / "0.png")
    pointer(tmp_path / "bench/ground_truth_new.npy")
    refused(lambda: import_route("vprbench", tmp_path / "bench", tmp_path / "out"), "ground_truth_new.npy")
    pointer(tmp_path / "tum/rgb.txt")
    refused(lambda: import_route("tum", tmp_path / "tum", tmp_path / "out"), "rgb.txt")
    shutil.copytree(tmp_path / "bench/query", tmp_path / "hloc/images")
    (tmp_path / "hloc/pairs.txt").write_text("images/0.png images/0.png\n")
    pointer(tmp_path / "hloc/features.h5")
    refused(
        lambda: import_route("hloc", tmp_path / "hloc", tmp_path / "out", {"queries": "features.h5"}), "features.h5"
    )
