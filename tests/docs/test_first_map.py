"""The commands of the first map run as they stand, on two videos."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.mapping.drives import images_of, write_video

DOCS = Path(__file__).parents[2] / "docs"


def commands(page: str) -> str:
    return "\n".join(re.findall(r"^```sh\n(.*?)^```$", (DOCS / page).read_text("utf-8"), re.MULTILINE | re.DOTALL))


def run(page: str, directory: Path) -> str:
    launcher = directory / "bin" / "everplace"
    launcher.parent.mkdir()
    launcher.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m everplace "$@"\n')
    launcher.chmod(0o755)
    environment = {**os.environ, "PATH": f"{launcher.parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["sh", "-e", "-c", commands(page)], cwd=directory, capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_first_map_is_made_in_three_commands(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    for name in ("summer", "winter"):
        write_video(tmp_path / f"{name}.mp4", images_of(unchanged_rendered_route / name))
    assert commands("first-map.md").count("everplace ") == 3
    printed = run("first-map.md", tmp_path)
    answers = [json.loads(line) for line in printed.splitlines() if line.startswith('{"frame"')]
    assert len(answers) == 60
    assert answers[0]["provisional"]
    near = [abs(answer["place"] - number) <= 1 for number, answer in enumerate(answers)]
    assert sum(near) >= 45


@pytest.mark.slow
def test_loop_closures_of_a_drive_that_comes_back(unchanged_rendered_route: Path, tmp_path: Path) -> None:
    pytest.importorskip("av", reason="needs the extra video")
    write_video(tmp_path / "drive.mp4", images_of(unchanged_rendered_route / "summer"))
    run("loop-closures.md", tmp_path)
    assert (tmp_path / "closures.csv").read_text().startswith("frame,time,place")
