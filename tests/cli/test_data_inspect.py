from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from everplace.cli import main


@pytest.fixture
def broken_route(tiny_route: Path) -> Path:
    for stem in "25":
        (tiny_route / "winter" / f"{stem}.png").write_bytes(b"")
    Image.new("RGB", (64, 32)).save(tiny_route / "winter" / "7.png")
    (tiny_route / "summer" / "9.png").unlink()
    return tiny_route


def inspect(route: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[str, str]:
    assert main.run(["data", "inspect", str(route), *more]) == 0
    return capsys.readouterr()


def test_json_keeps_the_keys_of_before_and_lists_everything(
    broken_route: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, err = inspect(broken_route, capsys, "--json", "--sheet", str(tmp_path / "sheet.png"))
    assert err == ""
    result: dict[str, Any] = json.loads(out)
    assert result["route"] == str(broken_route)
    assert result["shared_places"] == 11
    assert (result["tolerance"], result["radius"]) == (None, None)
    assert (result["truth_from"], result["aligned_by"]) == (None, None)
    summer, winter = result["traverses"]["summer"], result["traverses"]["winter"]
    assert (summer["condition"], summer["frames"], summer["poses"]) == ("summer", 11, False)
    assert list(winter["unreadable"]) == ["2", "5"]
    assert "0 bytes" in winter["unreadable"]["5"]
    assert summer["missing"] == ["9"]
    assert summer["gaps"] == [{"first": "8", "last": "10", "count": 1}]
    assert result["tunnels"] == [{"first": "7", "last": "7", "count": 1}]
    assert (result["unreadable_places"], result["dark_places"], result["kept_places"]) == (2, 1, 8)
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.format == "PNG"


def test_for_people_every_unreadable_file_is_a_line_and_long_lists_are_cut(
    broken_route: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in range(3, 12):
        (broken_route / "winter" / f"{place}.png").unlink()
    out, err = inspect(broken_route, capsys)
    assert [line.split(" is ")[0] for line in err.splitlines()] == [f"everplace: {broken_route}/winter/2.png"]
    assert "traverses.winter.unreadable" in out
    assert "3, 4, 5, 6, 7, ... and 3 more" in out


def test_a_sheet_of_another_kind_is_refused_before_the_work(
    tiny_route: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["data", "inspect", str(tiny_route), "--sheet", "sheet.jpg"]) == 2
    assert "must end in .png or .svg or .pdf" in capsys.readouterr().err


def test_where_the_truth_comes_from_is_shown(tiny_route: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tiny_route / "route.toml").write_text('truth_from = "an alignment"\naligned_by = "hog"\n')
    out, _ = inspect(tiny_route, capsys)
    assert dict(line.split(maxsplit=1) for line in out.splitlines() if line.startswith(("truth", "aligned"))) == {
        "truth_from": "an alignment",
        "aligned_by": "hog",
    }
