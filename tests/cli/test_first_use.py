"""What a person meets first: help that is whole, mistakes told at once, and Ctrl-C that says what stands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.cli.test_main import call
from tests.forked import ForkedProcess
from typer.main import get_command

from everplace.cli import main


@pytest.mark.parametrize("group", [(), ("data",), ("show",)])
def test_the_list_of_commands_says_each_summary_whole(group: tuple[str, ...]) -> None:
    command = get_command(main.app)
    for name in group:
        command = command.commands[name]  # type: ignore[attr-defined]
    listed = "".join(call(*group, "--help")[1].partition("Commands:")[2].split())
    for name, one in command.commands.items():  # type: ignore[attr-defined]
        summary = (one.help or "").partition("\n\n")[0]
        assert "".join(f"{name}{summary}".split()) in listed


@pytest.mark.parametrize(
    "arguments",
    [
        ("train", "{unaligned}", "--model", "cp-vae"),
        ("train", "{unaligned}", "--model", "vae", "--frames", "5-9"),
        ("train", "nowhere", "--model", "vae"),
        ("evaluate", "nowhere", "--method", "hog", "--database", "summer", "--query", "winter"),
        ("evaluate", "{unaligned}", "--method", "hog", "--database", "summer", "--query", "night"),
        ("compare", "nowhere", "--methods", "hog"),
        ("compare", "{unaligned}", "--methods", "hog", "--conditions", "night"),
        ("compare", "{unaligned}", "--methods", "hog", "--frames", "5-9"),
        ("compare", "{unaligned}", "--methods", "hog,sad"),
        ("compare", "{unaligned}", "--methods", "hog,sad", "--drop-dark", "--tolerance", "2"),
        ("compare", "{unaligned}", "--methods", "cp-vae,hog", "--fit-frames", ":4", "--frames", "6:"),
        ("compare", "{unaligned}", "--methods", "hog", "--conditions", "summer"),
        ("compare", "{unaligned}", "--methods", "hog", "--tolerance", "1", "--radius", "5"),
        ("compare", "{unaligned}", "--methods", "hog", "--tolerance", "1", "--fit-frames", "7"),
    ],
)
def test_what_is_wrong_with_a_route_is_said_before_torch_is_imported(
    tiny_route: Path, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    for frame in (tiny_route / "winter").iterdir():
        frame.rename(frame.with_name(f"w{frame.name}"))
    given = [part.format(unaligned=tiny_route) for part in arguments]
    code = (
        "import sys; from everplace.cli import main; status = main.run(sys.argv[1:])\n"
        "sys.exit(','.join({'torch', 'sklearn', 'matplotlib'} & set(sys.modules)) or status)"
    )
    command = [sys.executable, "-c", code, *given, "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_ctrl_c_before_the_first_epoch_names_the_run_and_resume(
    make_landscapes: Callable[[Path, int], Path], tmp_path: Path
) -> None:
    route, out = make_landscapes(tmp_path / "route", 200), tmp_path / "run"
    command = ["-m", "everplace", "train", str(route), "--model", "cp-vae", "--out", str(out)]
    command += ["--image-size", "224", "224", "--minutes", "5"]
    with ForkedProcess(*command, stderr=subprocess.PIPE, env={**os.environ, "NO_COLOR": "1"}) as process:
        while not (out / "config.toml").exists():
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        said = process.communicate()[1].strip().splitlines()[-1]
    assert process.returncode == 130
    assert said.startswith(f"everplace: stopped; {out} holds the settings and no epoch yet")
    assert said.endswith("--resume")
