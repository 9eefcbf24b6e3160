"""The page on the architecture draws the rooms as the layer contract has them."""

from __future__ import annotations

import re
from pathlib import Path

import tomllib

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_the_drawing_has_the_layers_of_the_contract() -> None:
    drawing = re.findall(r"^```\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0]
    drawn = [sorted(re.findall(r"\b([a-z]+)/ ", line)) for line in drawing.splitlines()]
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"][0]
    rooms = {path.name for path in (ROOT / "src" / "everplace").iterdir() if (path / "__init__.py").is_file()}
    layers = [sorted(set(re.findall(r"everplace\.(\w+)", layer)) & rooms) for layer in contract["layers"]]
    assert [line for line in drawn if line] == [layer for layer in layers if layer]


def test_every_room_has_a_row() -> None:
    rows = re.findall(r"^\| `([a-z]+)/` \|", PAGE, re.MULTILINE)
    rooms = {path.parent.name for path in (ROOT / "src" / "everplace").glob("*/__init__.py")}
    assert sorted(rows) == sorted(rooms)
