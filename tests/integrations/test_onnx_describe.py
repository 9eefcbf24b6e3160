"""The script that describes and localises without torch and without everplace."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from everplace.describe.registry import open_describer
from everplace.experiments.exported_run import export_run
from everplace.mapping.route_learning import adapt
from everplace.mapping.route_map import Map
from everplace.route.folder import open_traverse
from everplace.route.route import open_route

SCRIPT = Path(__file__).parents[2] / "integrations" / "onnx" / "describe.py"

pytestmark = pytest.mark.slow


def run_alone(tmp_path: Path, *arguments: str | Path) -> list[dict[str, Any]]:
    """Runs the script where importing torch or everplace fails."""
    for name in ("torch", "everplace"):
        (tmp_path / "forbidden" / name).mkdir(parents=True, exist_ok=True)
        (tmp_path / "forbidden" / name / "__init__.py").write_text("raise AssertionError('forbidden')\n")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "forbidden")}
    probe = subprocess.run([sys.executable, "-c", "import everplace"], env=environment, capture_output=True, text=True)
    assert "forbidden" in probe.stderr
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def run(unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An adapted run; nobody may change it."""
    path = tmp_path_factory.mktemp("adapted") / "run"
    adapt("hog16", open_route(unchanged_tiny_route), path, dimensions=8, prior="none")
    return path


@pytest.fixture(scope="module")
def network(run: Path, unchanged_tiny_route: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its ONNX network; nobody may change it."""
    path = tmp_path_factory.mktemp("exported") / "net.onnx"
    export_run(run, path, route=open_route(unchanged_tiny_route))
    return path


@pytest.mark.parametrize("int8", [False, True])
def test_it_describes_as_everplace_does(run: Path, network: Path, tmp_path: Path, tiny_route: Path, int8: bool) -> None:
    if int8:
        network = tmp_path / "net.onnx"
        export_run(run, network, int8=True, route=open_route(tiny_route))
    winter = open_route(tiny_route)["winter"]
    answers = run_alone(tmp_path, network, *winter.paths)
    assert [answer["image"] for answer in answers] == list(map(str, winter.paths))
    theirs = np.array([answer["descriptor"] for answer in answers])
    ours = open_describer(f"onnx:{network}").describe(winter).values
    np.testing.assert_allclose(theirs, ours, atol=1e-3 if not int8 else 0.2)
    if not int8:
        np.testing.assert_allclose(theirs, open_describer(str(run)).describe(winter).values, atol=1e-3)


def test_a_picture_that_lies_on_its_side_is_turned_and_one_of_16_bits_refused(network: Path, tmp_path: Path) -> None:
    (tmp_path / "drive").mkdir()
    exif = Image.Exif()
    exif[0x0112] = 6
    pixels = np.random.default_rng(0).integers(0, 256, (12, 20, 3), dtype=np.uint8)
    Image.fromarray(pixels).resize((200, 120)).save(tmp_path / "drive" / "1.jpg", quality=95, exif=exif)
    (answer,) = run_alone(tmp_path, network, tmp_path / "drive" / "1.jpg")
    ours = open_describer(f"onnx:{network}").describe(open_traverse(tmp_path / "drive")).values
    np.testing.assert_allclose(answer["descriptor"], ours[0], atol=0.02)
    Image.fromarray(np.arange(240, dtype=np.uint16).reshape(12, 20) * 200).save(tmp_path / "deep.png")
    done = subprocess.run(
        [sys.executable, str(SCRIPT), str(network), str(tmp_path / "deep.png")],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "has more than 8 bits a pixel" in done.stderr


def test_a_network_of_no_version_of_the_map_is_refused(
    network: Path, unchanged_summer_map: Path, unchanged_rendered_route: Path
) -> None:
    image = unchanged_rendered_route / "winter" / "00003.png"
    command = [sys.executable, str(SCRIPT), str(network), str(image), "--map", str(unchanged_summer_map)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert "was not exported from a version of" in done.stderr


def test_it_finds_frames_on_a_map_of_the_version_that_was_exported(
    three_map: Path, unchanged_rendered_route: Path, tmp_path: Path
) -> None:
    m = Map.open(three_map)
    export_run(three_map, tmp_path / "map.onnx")
    m.remove("autumn")  # a later version, with other descriptors
    names = [f"{place:05d}" for place in (3, 20, 41)]
    images = [unchanged_rendered_route / "winter" / f"{name}.png" for name in names]
    answers = run_alone(tmp_path, tmp_path / "map.onnx", *images, "--map", three_map)
    assert [(answer["drive"], answer["stem"], answer["place"]) for answer in answers] == [
        ("winter", name, int(name)) for name in names
    ]
    assert min(answer["cosine"] for answer in answers) > 0.99
