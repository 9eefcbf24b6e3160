"""The registry finds methods by their file and says what there is."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from everplace.describe import methods
from everplace.describe.registry import kind_of_run, load, method_names, open_describer
from everplace.errors import MethodError
from everplace.images.decoding import ImageSpec, decode_image
from everplace.progress import quiet
from everplace.route.route import open_route


def test_methods_open_by_name() -> None:
    names = method_names()
    assert names == sorted(names)
    assert {"alexnet", "hog", "hub", "onnx", "sad", "vgg19"} <= set(names)
    assert not {"vae", "cae", "fabmap", "trained"} & set(names)  # a trained model is given by its run directory
    for name in ("hog", "sad"):
        assert open_describer(name).method == name


def test_a_new_file_is_a_new_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "echo.py").write_text("def open_method(argument):\n    return argument\n")
    (tmp_path / "_helper.py").write_text("")
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path)])
    assert "echo" in method_names()
    assert "_helper" not in method_names()
    assert open_describer("echo:https://host/a:b") == "https://host/a:b"  # type: ignore[comparison-overlap]
    del sys.modules["everplace.describe.methods.echo"]


NEW_METHOD = """
from everplace.describe.describer import Describer
from everplace.images.decoding import ImageSpec

class Brightness(Describer):
    method, image, dimension = "brightness", ImageSpec(grey=True), 1

    def settings(self):
        return {}

    def describe_batch(self, images):
        return images.mean(axis=(1, 2), dtype="float32")

def open_method(argument):
    return Brightness()
"""


def test_one_file_with_two_methods_is_all_that_a_new_method_needs(
    tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "brightness.py").write_text(NEW_METHOD)
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path)])
    winter = open_route(tiny_route)["winter"]
    described = open_describer("brightness").describe(winter)
    assert described.names == winter.stems
    assert described.values[:, 0] == pytest.approx(
        [decode_image(path, ImageSpec(grey=True)).mean() for path in winter.paths]
    )
    del sys.modules["everplace.describe.methods.brightness"]


def test_what_a_method_needs_from_the_net_is_fetched_before_it_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "deep.py").write_text(
        "steps = []\n"
        "def prepare(argument, progress):\n    steps.append(('prepare', argument, progress))\n"
        "def open_method(argument):\n    return [*steps, argument]\n"
    )
    monkeypatch.setattr(methods, "__path__", [*methods.__path__, str(tmp_path)])
    opened: object = open_describer("deep:x", progress=quiet)
    assert opened == [("prepare", "x", quiet), "x"]
    del sys.modules["everplace.describe.methods.deep"]


@pytest.mark.parametrize(
    ("kind", "module"),
    [
        ("vae", "trained"), ("cp-vae", "trained"), ("cae", "trained"), ("fabmap", "fabmap"), ("later", "trained"),
        ("../trained", "trained"),
    ],
)  # fmt: skip
def test_a_run_directory_says_what_opens_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, module: str
) -> None:
    for name in ("trained", "fabmap"):
        fake = SimpleNamespace(open_method=lambda argument, name=name: (name, argument))
        monkeypatch.setitem(sys.modules, f"everplace.describe.runs.{name}", fake)
    (tmp_path / "config.toml").touch()
    assert open_describer(tmp_path) == ("trained", str(tmp_path))  # type: ignore[comparison-overlap]
    (tmp_path / "checkpoint.json").write_text(json.dumps({"model": {"kind": kind}}))
    assert kind_of_run(tmp_path) == kind
    assert open_describer(str(tmp_path)) == (module, str(tmp_path))  # type: ignore[comparison-overlap]


@pytest.mark.parametrize("method", ["nothing", "", "vae", "HOG", "_x", "hog/..", "a\0b", "x" * 5000, "../sad"])
def test_an_unknown_method_is_refused_with_what_there_is(method: str) -> None:
    with pytest.raises(MethodError, match=r"there is no method .* hog, .*sad.* run directory"):
        open_describer(method)


def test_a_directory_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match=r"holds no config\.toml; choose one of"):
        open_describer(str(tmp_path))


@pytest.mark.parametrize("name", ["hog", "sad"])
def test_a_method_without_options_refuses_an_argument(name: str) -> None:
    with pytest.raises(MethodError, match=f"write {name} instead of {name}:fast"):
        open_describer(f"{name}:fast")


@pytest.mark.parametrize("device", ["nonsense", "cuda:99"])
def test_a_device_that_is_not_there_is_refused(device: str) -> None:
    with pytest.raises(MethodError, match=f"there is no device '{device}' here"):
        load("hog", device=device)


def test_a_network_is_opened_on_the_device_asked_for(tmp_path: Path) -> None:
    (tmp_path / "hubconf.py").write_text(
        "from torch import nn\n\n\ndef net():\n    return nn.Sequential(nn.AdaptiveAvgPool2d(2), nn.Flatten())\n"
    )
    with pytest.raises(MethodError):  # the device without memory computes nothing
        load(f"hub:{tmp_path}:net", device="meta")
    assert load(f"hub:{tmp_path}:net", device="cpu").dimension == 12
