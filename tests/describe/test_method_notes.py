"""The list of methods says what they are, and holds all of them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.cli.test_main import call

from everplace.describe.method_notes import method_notes
from everplace.describe.registry import method_names, open_describer
from everplace.fabmap.fabmap_model import FabMapConfig
from everplace.model.model_config import ModelConfig
from everplace.training.fitted_methods import FITTED_METHODS

ROOT = Path(__file__).parents[2]
NOTES = {note.method: note for note in method_notes()}


def test_all_methods_are_listed() -> None:
    assert {re.split("[:+]", name)[0] for name in NOTES} >= set(method_names())
    assert {name.removeprefix("RUN of ") for name in NOTES} >= set(FITTED_METHODS)
    assert all(note.summary and "\n" not in note.summary for note in NOTES.values())


@pytest.mark.parametrize("method", ["sad", "hog"])
def test_the_numbers_are_those_of_the_method(method: str) -> None:
    assert NOTES[method].numbers == open_describer(method).dimension


@pytest.mark.parametrize("kind", ["vae", "c-vae", "cp-vae", "cae"])
def test_the_numbers_are_those_of_the_networks(kind: str) -> None:
    config = ModelConfig(kind=kind, conditions=("a", "b"), places=5)  # type: ignore[arg-type]
    assert NOTES[f"RUN of {kind}"].numbers == config.descriptor_dimensions


def test_the_numbers_are_those_of_fabmap() -> None:
    assert NOTES["RUN of fabmap"].numbers == 2 * FabMapConfig().words + 1


def test_the_docs_name_the_same_networks_of_torch_hub() -> None:
    page = (ROOT / "docs" / "how-it-works.md").read_text("utf-8")
    rows = {name: int(numbers.replace(",", "")) for name, numbers in re.findall(r"\| `(hub:\S+)` \| ([\d,]+) \|", page)}
    assert len(rows) == 6
    assert rows == {name: note.numbers for name, note in NOTES.items() if name.startswith("hub:") and note.numbers}


def test_the_command_prints_them() -> None:
    status, out, _ = call("methods")
    assert status == 0
    assert "sad: " in out
    assert "MixVPR" in out
    assert "    needs EVERPLACE_TRUST_HUB=serizba/salad" in out
    status, out, _ = call("methods", "--json")
    assert status == 0
    assert {"method": "hog", "needs": "", "numbers": 3780, "summary": NOTES["hog"].summary} in json.loads(out)[
        "methods"
    ]


def test_nothing_heavy_is_imported() -> None:
    code = (
        "import sys; from everplace.cli import main; status = main.run(['methods'])\n"
        "heavy = {'torch', 'cv2', 'scipy', 'h5py', 'numpy', 'PIL', 'onnxruntime'}\n"
        "sys.exit(','.join(sorted(heavy & set(sys.modules))) or status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
