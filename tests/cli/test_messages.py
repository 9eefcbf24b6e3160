"""What the command says of wrong input: options by their own names, both files, and no text of a megabyte."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np
import pytest
from tests.cli.test_main import refused

LONG = "x" * 10**6
Attributes: TypeAlias = dict[str, Any]


def write(path: Path, dimension: int = 4, **attributes: Any) -> Path:
    content = {"method": "m", "metric": "cosine", "settings": {}} | attributes
    with h5py.File(path, "w", libver="latest") as file:  # the latest format holds long attributes
        file["descriptors"] = np.ones((2, dimension), np.float32)
        file.create_dataset("names", data=[b"0", b"1"], dtype=h5py.string_dtype())
        file.attrs["method"], file.attrs["metric"] = content["method"], content["metric"]
        file.attrs["settings"] = json.dumps(content["settings"])
    return path


@pytest.mark.parametrize(
    ("options", "option"),
    [
        (["--image-size", "481", "641"], "--image-size: (481, 641)"),
        (["--format", "gif"], "--format: 'gif'"),
        (["--conditions", "fog"], "--conditions: ('fog',)"),
        (["--seed", str(2**63)], f"--seed: {2**63}"),
    ],
)
def test_an_option_of_render_is_called_by_its_name(tmp_path: Path, options: list[str], option: str) -> None:
    assert option in refused("data", "render", "--out", tmp_path / "route", *options)


@pytest.mark.parametrize(
    ("ours", "theirs", "what"),
    [
        (
            {"method": "hog"},
            {"method": "sad"},
            "the method of the query {query} is hog and of the database {known} sad",
        ),
        ({"dimension": 5}, {}, "the dimension of the query {query} is 5 and of the database {known} 4"),
        ({}, {"settings": {"cell": 8}}, "setting cell of the query {query} is not set and of the database {known} 8"),
        ({"metric": "mean-absolute-difference"}, {}, "the metric of the query {query} is mean-absolute-difference and"),
    ],
)
def test_descriptors_that_differ_are_named_by_their_files(
    tmp_path: Path, ours: Attributes, theirs: Attributes, what: str
) -> None:
    query, known = write(tmp_path / "q.h5", **ours), write(tmp_path / "d.h5", **theirs)
    said = refused("match", known, query, "--out", tmp_path / "out.csv")
    assert what.format(query=query, known=known) in said


@pytest.mark.parametrize(
    "long",
    [{"method": LONG}, {"metric": LONG}, {"settings": {"cell": LONG}}, {"settings": {LONG: 1}}],
    ids=["method", "metric", "value", "name"],
)
def test_a_long_attribute_is_cut(tmp_path: Path, long: Attributes) -> None:
    query, known = write(tmp_path / "q.h5", **long), write(tmp_path / "d.h5")
    said = refused("match", known, query, "--out", tmp_path / "out.csv")
    assert "xxx ... xxx" in said
    assert len(said) < 400 + len(str(query)) + len(str(known))


def test_a_long_name_of_a_frame_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "q.h5"
    with h5py.File(path, "w") as file:
        file["descriptors"] = np.ones((2, 4), np.float32)
        file.create_dataset("names", data=[LONG.encode()] * 2, dtype=h5py.string_dtype())
    said = refused("match", path, path, "--out", tmp_path / "out.csv")
    assert "xxx ... xxx" in said
    assert "occurs twice" in said
