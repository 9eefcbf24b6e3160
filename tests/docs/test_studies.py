"""The studies that the results name exist, and `--help` lists all of them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from studies.__main__ import study

DOCS = Path(__file__).parents[2] / "docs"


def test_the_usage_line_lists_every_study_of_the_docs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["studies", "--help"])
    with pytest.raises(SystemExit):
        study()
    listed = re.search(r"\{(.*?)\}", capsys.readouterr().out)
    assert listed
    named = set(re.findall(r"python -m studies (\w+)", "".join(page.read_text("utf-8") for page in DOCS.glob("*.md"))))
    assert named == set(listed[1].split(","))
