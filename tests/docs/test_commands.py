"""The commands of all pages are commands with these options, and those of make are targets."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.main import get_command

from everplace.cli.main import app

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("studies/**/*.md")]
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in sorted(PAGES))
SHELL = "\n".join(re.findall(r"^```sh\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)).replace("\\\n", "")
COMMANDS = {line.strip() for line in SHELL.splitlines() if line.strip().startswith("everplace ")}
COMMANDS |= {" ".join(span.split()) for span in re.findall(r"`(everplace [^`]* --[^`]*)`", TEXT) if "..." not in span}


@pytest.mark.parametrize("line", sorted(COMMANDS))
def test_a_command_and_its_options_exist(line: str) -> None:
    words = shlex.split(line.replace("$seed", "0").replace("$model", "cp-vae"), comments=True)
    command: Any = get_command(app)
    for index, word in enumerate(words[1:], start=1):
        if not hasattr(command, "commands"):
            break
        assert word in command.commands
        command, arguments = command.commands[word], words[index + 1 :]
    try:
        assert command.make_context(words[-1], arguments).params
    except typer.Exit as ended:  # of an option that says something and ends the command
        assert ended.exit_code == 0


def test_the_targets_of_make_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    named = set(re.findall(r"^make ([a-z-]+)", SHELL, re.MULTILINE))
    named |= set(re.findall(r"`make ([a-z-]+)`", TEXT))
    named |= set(re.findall(r"make ([a-z-]+)$", (ROOT / ".github/workflows/ci.yml").read_text("utf-8"), re.MULTILINE))
    assert {"test-fast", "lint", "docs"} <= named <= targets
