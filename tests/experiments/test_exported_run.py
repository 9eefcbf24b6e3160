"""Exporting with a look at what it costs: calibrated on a route or rendered frames, compared on the route."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from everplace.cli import main
from everplace.describe.registry import open_describer
from everplace.errors import RouteError
from everplace.experiments.exported_run import export_run
from everplace.mapping.route_learning import adapt
from everplace.mapping.route_map import Map
from everplace.route.route import open_route


@pytest.fixture(scope="module")
def run(unchanged_rendered_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exported") / "run"
    adapt("hog16", open_route(unchanged_rendered_route).choose(["summer", "autumn"]), out, dimensions=24, prior="none")
    return out


def call(*arguments: str | Path) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main.run([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


@pytest.mark.slow
def test_eight_bits_keep_the_scores_and_that_is_shown(
    run: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    status, out, err = call(
        "export", run, "--onnx", tmp_path / "net.onnx", "--int8", "--route", unchanged_rendered_route,
        "--conditions", "summer,winter", "--json",
    )  # fmt: skip
    assert (status, err) == (0, "")
    told = json.loads(out)
    assert (told["database"], told["query"]) == ("summer", "winter")
    assert told["calibrated_on"] == "120 frames of road"
    assert told["auc_pr"]["run"] > 0.5
    assert abs(told["auc_pr"]["exported"] - told["auc_pr"]["run"]) <= 0.01
    assert told["difference"] > 1e-4
    assert told["cosine"] > 0.98


@pytest.mark.slow
def test_without_a_route_eight_bits_are_calibrated_on_rendered_frames(run: Path, tmp_path: Path) -> None:
    status, out, err = call("export", run, "--onnx", tmp_path / "net.onnx", "--int8", "--json")
    assert status == 0
    assert "the 8-bit ranges were measured on rendered frames" in err
    told = json.loads(out)
    assert told["calibrated_on"].endswith("rendered frames")
    assert "auc_pr" not in told
    assert told["cosine"] > 0.95


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:60 of the 60 descriptors")
def test_a_network_that_lost_its_way_is_warned_of(
    run: Path, unchanged_rendered_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    black = [np.zeros((64, 128, 1), np.uint8)]
    monkeypatch.setattr("everplace.experiments.exported_run._frames", lambda route, image: black)
    status, _, err = call(
        "export", run, "--onnx", tmp_path / "net.onnx", "--int8", "--route", unchanged_rendered_route,
        "--conditions", "summer,winter",
    )  # fmt: skip
    assert status == 0
    assert "the exported network loses 0." in err
    assert "export it without --int8" in err


@pytest.mark.slow
def test_a_map_is_exported_with_its_own_descriptors(
    three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    m = Map.open(three_map)
    export_run(three_map, tmp_path / "map.onnx")
    network = open_describer(f"onnx:{tmp_path / 'map.onnx'}")
    assert network.settings()["map_version"] == m.version == 3
    described = network.describe(open_route(unchanged_rendered_route)["summer"]).values
    np.testing.assert_allclose(described, m.descriptors()[:60], atol=0.02)  # those of the map are of 16-bit features


@pytest.mark.parametrize("broken", ["alone", "unaligned"])
def test_a_route_that_cannot_be_scored_is_refused(tiny_route: Path, tmp_path: Path, broken: str) -> None:
    if broken == "alone":
        shutil.rmtree(tiny_route / "winter")
    else:
        (tiny_route / "route.toml").write_text("aligned = false\n")
    with pytest.raises(RouteError, match="`route` is to compare scores on, so it wants two traverses"):
        export_run("hog16", tmp_path / "net.onnx", route=open_route(tiny_route))
    assert not (tmp_path / "net.onnx").exists()
