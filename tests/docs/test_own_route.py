"""The examples of route.toml are read as they stand, and with any one setting switched on."""

from __future__ import annotations

import re
from pathlib import Path

from everplace.route.route_toml import RouteToml, TraverseToml, read_route_toml

PAGE = (Path(__file__).parents[2] / "docs" / "own-route.md").read_text(encoding="utf-8")
SHORT, LONG = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_short_example_can_be_pasted(tmp_path: Path) -> None:
    (tmp_path / "route.toml").write_text(SHORT, encoding="utf-8")
    assert read_route_toml(tmp_path) == RouteToml(tolerance=3)


def test_the_long_example_switches_nothing_on(tmp_path: Path) -> None:
    (tmp_path / "route.toml").write_text(LONG, encoding="utf-8")
    assert read_route_toml(tmp_path) == RouteToml()


def test_the_long_example_has_every_setting(tmp_path: Path) -> None:
    before, after = (
        re.findall(r"^# (\w+ = .*)$", part, re.MULTILINE) for part in LONG.split("# [traverses.drive_07]\n")
    )
    for line in before:
        (tmp_path / "route.toml").write_text(line, encoding="utf-8")
        read_route_toml(tmp_path)
    (tmp_path / "route.toml").write_text("[traverses.drive_07]\n" + "\n".join(after), encoding="utf-8")
    read_route_toml(tmp_path)
    assert {line.split()[0] for line in before} == RouteToml.model_fields.keys() - {"traverses"}
    assert {line.split()[0] for line in after} == TraverseToml.model_fields.keys()
