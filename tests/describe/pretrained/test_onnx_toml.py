"""The TOML beside an ONNX network: read strictly, written so that it reads the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from everplace.describe.pretrained.onnx_toml import OnnxToml, onnx_toml_path, onnx_toml_text, read_onnx_toml
from everplace.errors import ConfigError

LEAST = 'image_size = [24, 32]\ncolour = "rgb"\nmean = [0.5]\nscale = [0.25]\n'


def write(directory: Path, text: str) -> Path:
    path = directory / "net.toml"
    path.write_text(text, "utf-8")
    return path


def test_the_least_file_has_defaults(tmp_path: Path) -> None:
    toml = read_onnx_toml(write(tmp_path, LEAST))
    assert toml == OnnxToml(image_size=(24, 32), colour="rgb", mean=(0.5,), scale=(0.25,))
    assert (toml.layout, toml.output, toml.l2, toml.channels) == ("nchw", None, False, 3)


def test_it_lies_beside_the_network() -> None:
    assert onnx_toml_path(Path("a/net.v2.onnx")) == Path("a/net.v2.toml")


@pytest.mark.parametrize(
    "toml",
    [
        OnnxToml(image_size=(1, 2), colour="grey"),
        OnnxToml(
            image_size=(480, 640),
            colour="bgr",
            mean=(0.1, 0.2, 0.3),
            scale=(1.0, 2.0, 3.0),
            layout="nhwc",
            output="d",
            l2=True,
        ),
    ],
)
def test_what_is_written_reads_the_same(tmp_path: Path, toml: OnnxToml) -> None:
    assert read_onnx_toml(write(tmp_path, onnx_toml_text(toml))) == toml


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LEAST + "std = [1]\n", "unknown key 'std' in .*net.toml; known here: colour, image_size, l2"),
        (LEAST.replace("colour", "color"), "lacks 'colour'; add it|unknown key 'color'"),
        (LEAST.replace('"rgb"', '"rbg"'), "wrong value of 'colour'"),
        (LEAST.replace("[24, 32]", "224"), "wrong value of 'image_size'"),
        (LEAST.replace("[24, 32]", "[24, 0]"), r"wrong value of 'image_size\.1'"),
        (LEAST.replace("[24, 32]", '["24", 32]'), r"wrong value of 'image_size\.0'"),
        (LEAST.replace("scale = [0.25]\n", ""), "mean and scale belong together"),
        (LEAST.replace("[0.25]", "[0.25, 0]"), "scale has 2 numbers for 3 channels"),
        (LEAST.replace("[0.25]", "[1, 0.0, 1]"), "scale may not be 0"),
        (LEAST.replace("[0.25]", "[inf]"), "wrong value of 'scale.0'"),
        ("image_size = [", "is not valid TOML"),
        ("a = " + "[" * 5000, "is not valid TOML|nests its values too deeply"),
    ],
)
def test_mistakes_are_named_by_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read_onnx_toml(write(tmp_path, text))
    assert "net.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named_with_what_belongs_into_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"net\.toml is missing; write image_size, colour, mean and scale"):
        read_onnx_toml(tmp_path / "net.toml")
