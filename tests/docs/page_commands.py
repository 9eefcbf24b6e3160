"""Runs the blocks of a page as they stand, in this process, which has torch already."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from tests.cli.test_main import call
from tests.mapping.drives import images_of

__all__ = ["ROOT", "python_blocks", "run_block", "run_example", "shell_blocks"]

ROOT = Path(__file__).parents[2]


def shell_blocks(page: str) -> list[str]:
    """Those of a page, named from the project's root."""
    return re.findall(r"^```sh\n(.*?)^```$", (ROOT / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)


def python_blocks(page: str) -> list[str]:
    """Those of a page, named from the project's root."""
    return re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)


def run_example(code: str, drive: Path) -> None:
    """Runs Python code in which `camera` gives the first frames of a drive."""
    exec(code, {"camera": images_of(drive)[:12]})


def run_block(block: str) -> str:
    """Runs the commands of a block, each of which must succeed; returns what they printed."""
    return "".join(_run(words) for words in _commands(block))


def _commands(block: str) -> Iterator[list[str]]:
    for line in block.replace("\\\n", "").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield words


def _run(words: list[str]) -> str:
    assert words[0] == "everplace", words
    status, out, err = call(*words[1:])
    assert status == 0, f"{shlex.join(words)}: {err}"
    return out
