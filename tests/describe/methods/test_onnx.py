"""ONNX networks, written here operator by operator: mean colours, whose descriptors are known."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from everplace.describe.methods.onnx import open_method
from everplace.describe.registry import open_describer
from everplace.errors import ConfigError, MethodError, MissingExtraError
from everplace.images.decoding import ImageSpec
from everplace.route.route import open_route

H, W = 6, 10
TOML = 'image_size = [6, 10]\ncolour = "rgb"\nmean = [0.1, 0.2, 0.3]\nscale = [0.5, 1.0, 2.0]\n'
PIXELS = 'image_size = [6, 10]\ncolour = "rgb"\n'


def write_network(
    directory: Path,
    toml: str | None = TOML,
    *,
    shape: tuple[int | str | None, ...] = ("n", 3, H, W),
    axes: tuple[int, ...] = (2, 3),
    input_type: int = TensorProto.FLOAT,
    weights: NDArray[np.float32] | None = None,
    outputs: tuple[str, ...] = ("descriptor",),
) -> Path:
    """A network that gives the mean over the image of every channel, times a 3×3 matrix."""
    matrix = np.eye(3, dtype=np.float32) if weights is None else weights
    nodes = [
        helper.make_node("Cast", ["images"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["numbers"], ["mean"], axes=list(axes), keepdims=0),
        helper.make_node("MatMul", ["mean", "matrix"], ["descriptor"]),
    ]
    kinds = {
        "descriptor": helper.make_tensor_value_info("descriptor", TensorProto.FLOAT, None),
        "numbers": helper.make_tensor_value_info("numbers", TensorProto.FLOAT, None),
    }
    graph = helper.make_graph(
        nodes,
        "mean-colour",
        [helper.make_tensor_value_info("images", input_type, shape)],
        [kinds[name] for name in outputs],
        [numpy_helper.from_array(matrix, "matrix")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    path = directory / "net.onnx"
    onnx.save(model, str(path))
    if toml is not None:
        path.with_suffix(".toml").write_text(toml)
    return path


def batch(frames: int, channels: int = 3) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (frames, H, W, channels), dtype=np.uint8)


def expected(images: NDArray[np.uint8]) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = images.astype(np.float64).mean(axis=(1, 2)) / 255
    return (mean - [0.1, 0.2, 0.3]) / [0.5, 1.0, 2.0]


def test_the_toml_says_how_images_are_prepared(tmp_path: Path) -> None:
    path = write_network(tmp_path)
    describer = open_describer(f"onnx:{path}")
    assert (describer.method, describer.dimension, describer.metric) == ("onnx:net", 3, "cosine")
    assert describer.image == ImageSpec((H, W))
    values = describer.describe_batch(batch(5))
    assert values.dtype == np.float32
    assert np.allclose(values, expected(batch(5)), atol=1e-5)
    assert describer.settings() == {
        "image_size": "6 10", "colour": "rgb", "mean": "0.1 0.2 0.3", "scale": "0.5 1.0 2.0", "layout": "nchw",
        "l2": False, "weights": hashlib.sha256(path.read_bytes()).hexdigest()[:16],
    }  # fmt: skip


def test_blue_comes_first_where_the_toml_says_so(tmp_path: Path) -> None:
    describer = open_method(str(write_network(tmp_path, TOML.replace("rgb", "bgr"))))
    assert np.allclose(describer.describe_batch(batch(2)), expected(batch(2)[..., ::-1]), atol=1e-5)


def test_grey_is_one_channel(tmp_path: Path) -> None:
    toml = 'image_size = [6, 10]\ncolour = "grey"\nmean = [0.5]\nscale = [0.5]\n'
    weights = np.array([[1.0, -1.0]], np.float32)
    describer = open_method(str(write_network(tmp_path, toml, shape=("n", 1, H, W), weights=weights)))
    assert describer.image == ImageSpec((H, W), grey=True)
    mean = (batch(2, 1).astype(np.float64).mean(axis=(1, 2)) / 255 - 0.5) / 0.5
    assert np.allclose(describer.describe_batch(batch(2, 1)), mean * [1, -1], atol=1e-5)


def test_channels_may_come_last(tmp_path: Path) -> None:
    path = write_network(tmp_path, TOML + 'layout = "nhwc"\n', shape=("n", H, W, 3), axes=(1, 2))
    assert np.allclose(open_method(str(path)).describe_batch(batch(3)), expected(batch(3)), atol=1e-5)


def test_pixels_are_handed_over_as_they_are_to_a_network_that_takes_them(tmp_path: Path) -> None:
    path = write_network(tmp_path, PIXELS, input_type=TensorProto.UINT8)
    values = open_method(str(path)).describe_batch(batch(3))
    assert np.allclose(values, batch(3).astype(np.float64).mean(axis=(1, 2)), atol=1e-3)


def test_half_precision_is_fed_as_such(tmp_path: Path) -> None:
    path = write_network(tmp_path, input_type=TensorProto.FLOAT16)
    assert np.allclose(open_method(str(path)).describe_batch(batch(3)), expected(batch(3)), atol=2e-3)


@pytest.mark.parametrize("frames", [1, 4, 6])
def test_a_fixed_batch_is_filled_up(tmp_path: Path, frames: int) -> None:
    describer = open_method(str(write_network(tmp_path, shape=(4, 3, H, W))))
    assert describer.batch == 4
    assert np.allclose(describer.describe_batch(batch(frames)), expected(batch(frames)), atol=1e-5)


def test_l2_divides_by_the_length_and_leaves_zero_alone(tmp_path: Path) -> None:
    describer = open_method(str(write_network(tmp_path, PIXELS + "l2 = true\n", input_type=TensorProto.UINT8)))
    images = batch(3)
    images[1] = 0
    lengths = np.linalg.norm(describer.describe_batch(images), axis=1)
    assert np.allclose(lengths, [1, 0, 1], atol=1e-6)


def test_one_of_several_outputs_is_named(tmp_path: Path) -> None:
    path = write_network(tmp_path, outputs=("numbers", "descriptor"))
    with pytest.raises(ConfigError, match=r"has the outputs numbers, descriptor; name one as `output` in .*net\.toml"):
        open_method(str(path))
    path.with_suffix(".toml").write_text(TOML + 'output = "descriptor"\n')
    assert open_method(str(path)).dimension == 3
    path.with_suffix(".toml").write_text(TOML + 'output = "numbers"\n')
    with pytest.raises(
        MethodError, match="returned an array of shape .* instead of one row an image; name an `output`"
    ):
        open_method(str(path))
    path.with_suffix(".toml").write_text(TOML + 'output = "other"\n')
    with pytest.raises(ConfigError, match="names the output 'other', but the network has numbers, descriptor"):
        open_method(str(path))


def test_a_traverse_is_described(tmp_path: Path, tiny_route: Path) -> None:
    describer = open_method(str(write_network(tmp_path)))
    described = describer.describe(open_route(tiny_route)["summer"])
    assert described.values.shape == (12, 3)
    assert described.settings["weights"] == describer.settings()["weights"]


def test_other_weights_are_other_settings_also_where_they_lie_in_a_file_of_their_own(tmp_path: Path) -> None:
    def hash_with(value: float) -> object:
        path = write_network(tmp_path, weights=np.full((3, 300), value, np.float32))
        model = onnx.load(str(path))
        (tmp_path / "net.bin").unlink(missing_ok=True)
        onnx.save(model, str(path), save_as_external_data=True, location="net.bin", size_threshold=0)
        assert (tmp_path / "net.bin").stat().st_size >= 3600
        describer = open_method(str(path))
        assert describer.dimension == 300
        return describer.settings()["weights"]

    first = hash_with(1.0)
    assert hash_with(1.0) == first
    assert hash_with(2.0) != first
    (tmp_path / "net.bin").unlink()
    with pytest.raises(MethodError, match=r"cannot read .*net\.bin.*copy the network with all its files"):
        open_method(str(tmp_path / "net.onnx"))


def test_a_network_of_another_maker_says_nothing_of_its_training(tmp_path: Path) -> None:
    describer = open_method(str(write_network(tmp_path)))
    assert describer.seen_stems == frozenset()
    assert sorted(describer.settings()) == ["colour", "image_size", "l2", "layout", "mean", "scale", "weights"]


@pytest.mark.parametrize("content", ["no JSON", "[1]", "[" * 200_000, "9" * 5000])
def test_a_damaged_note_of_the_training_is_refused(tmp_path: Path, content: str) -> None:
    path = write_network(tmp_path)
    model = onnx.load(str(path))
    helper.set_model_props(model, {"everplace.about": content})
    onnx.save(model, str(path))
    with pytest.raises(MethodError, match=r"what .*net\.onnx says of its making .* is damaged; export the run again"):
        open_method(str(path))


Change = Callable[[Path], Path]


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda d: d / "none.onnx", r"there is no ONNX file .*none\.onnx"),
        (lambda d: write_network(d, shape=("n", 3, 7, W)), r"takes images of shape .* TOML says B×3×6×10; correct"),
        (lambda d: write_network(d, shape=("n", H, W, 3), axes=(1, 2)), "takes images of shape"),
        (lambda d: write_network(d, shape=("n", 3), axes=(0,)), "takes images of shape"),
        (lambda d: write_network(d, input_type=TensorProto.INT32), r"takes tensor\(int32\); export it for one of"),
        (lambda d: write_network(d, shape=("n", 3, "h", "w"), axes=(1, 3)), "fails on an image of 6×10: "),
    ],
)
def test_networks_that_do_not_fit_are_refused(tmp_path: Path, write: Change, message: str) -> None:
    with pytest.raises(MethodError, match=message) as caught:
        open_method(str(write(tmp_path)))
    assert "\n" not in str(caught.value)


def test_mean_and_scale_must_fit_what_the_network_takes(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"takes tensor\(uint8\), .* leave out mean and scale in .*net\.toml"):
        open_method(str(write_network(tmp_path, input_type=TensorProto.UINT8)))
    with pytest.raises(ConfigError, match=r"takes tensor\(float\), .* state mean and scale in .*net\.toml"):
        open_method(str(write_network(tmp_path, PIXELS)))


def test_without_its_toml_a_network_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"net\.toml is missing"):
        open_method(str(write_network(tmp_path, None)))


@pytest.mark.parametrize("content", [b"", b"no network", b"\xff" * 100])
def test_a_file_that_is_no_network_is_refused(tmp_path: Path, content: bytes) -> None:
    path = write_network(tmp_path)
    path.write_bytes(content)
    with pytest.raises(MethodError, match=r"net\.onnx is no ONNX") as caught:
        open_method(str(path))
    assert "\n" not in str(caught.value)


def test_two_inputs_are_too_many(tmp_path: Path) -> None:
    kinds = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ("n", 3, H, W)) for name in ("a", "b", "c")]
    graph = helper.make_graph([helper.make_node("Add", ["a", "b"], ["c"])], "sum", kinds[:2], kinds[2:])
    path = write_network(tmp_path)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    with pytest.raises(MethodError, match=r"has 2 inputs \(a, b\)"):
        open_method(str(path))


@pytest.mark.parametrize("library", ["onnx", "onnxruntime"])
def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    path = write_network(tmp_path)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'everplace\[onnx\]'"):
        open_method(str(path))


def test_a_name_without_file_is_refused() -> None:
    with pytest.raises(ConfigError, match="write onnx:FILE.onnx"):
        open_describer("onnx")
