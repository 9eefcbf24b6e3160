"""Networks on the command line: settings that tell weights apart, and methods that cannot run."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

from everplace import downloads
from everplace.cli import main
from everplace.describe.methods import alexnet

HUBCONF = """
import torch
from torch import nn

def means(bias=0.0):
    network = nn.Sequential(nn.AdaptiveAvgPool2d(4), nn.Flatten(), nn.Linear(48, 8))
    with torch.no_grad():
        network[2].weight.copy_(torch.arange(384.0).cos().view(8, 48))
        network[2].bias.fill_(bias)
    return network
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    directory = tmp_path / "means"
    directory.mkdir()
    (directory / "hubconf.py").write_text(HUBCONF)
    return directory


def call(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


def test_descriptors_of_other_weights_are_not_matched(repository: Path, tiny_route: Path, tmp_path: Path) -> None:
    methods = {"one": f"hub:{repository}:means#size=32x64", "two": f"hub:{repository}:means?bias=1#size=32x64"}
    told = {}
    for name, method in methods.items():
        for condition in ("summer", "winter"):
            file = tmp_path / f"{name}-{condition}.h5"
            status, out, err = call("describe", method, tiny_route / condition, "--out", file, "--json")
            assert status == 0, err
            told[name] = json.loads(out)
    assert (told["one"]["dimension"], told["one"]["bytes_per_descriptor"]) == (8, 32)
    assert told["one"]["settings"]["weights"] != told["two"]["settings"]["weights"]
    matches = tmp_path / "m.csv"
    assert call("match", tmp_path / "one-summer.h5", tmp_path / "one-winter.h5", "--out", matches)[0] == 0
    matches.unlink()
    status, _, err = call("match", tmp_path / "one-summer.h5", tmp_path / "two-winter.h5", "--out", matches)
    assert status == 2
    assert "the setting arguments of the query" in err
    assert not matches.exists()


@pytest.mark.parametrize("method", ["hog", pytest.param("hub:{}:means#size=32x64", marks=pytest.mark.slow)])
def test_compare_leaves_out_what_has_no_weights_and_says_why(
    repository: Path, tiny_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    monkeypatch.setenv("EVERPLACE_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("EVERPLACE_TRUST_HUB", raising=False)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.setattr(downloads, "_ATTEMPTS", 1)
    monkeypatch.setattr(alexnet, "WEIGHTS", replace(alexnet.WEIGHTS, url="http://127.0.0.1:9/alexnet-7be5be79.pth"))
    kept = method.format(repository)
    left = ["alexnet", f"vgg19:{tmp_path / 'none.pth'}", "hub:some/means:means", f"onnx:{tmp_path / 'none.onnx'}"]
    out = tmp_path / "c"
    status, printed, err = call("compare", tiny_route, "--methods", ",".join([kept, *left]), "--out", out, "--json")
    assert status == 0, err
    metrics = json.loads(printed)
    assert list(metrics["left_out"]) == left
    told = [line for line in err.strip().splitlines() if "was measured beside other work" not in line]
    assert [line.split(" is left out: ")[0] for line in told] == [f"everplace: {m}" for m in left]
    assert "put it at" in metrics["left_out"]["alexnet"]
    assert "EVERPLACE_TRUST_HUB" in metrics["left_out"]["hub:some/means:means"]
    assert set(metrics["pairs"][0]["methods"]) == {kept}
    assert (out / "table.md").is_file()


def test_weights_that_are_no_file_are_one_sentence(tiny_route: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.pth").write_bytes(b"no weights")
    status, out, err = call(
        "describe", f"alexnet:{tmp_path / 'bad.pth'}", tiny_route / "summer", "--out", tmp_path / "x"
    )
    assert (status, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert "bad.pth is refused" in err
    assert not (tmp_path / "x").exists()
