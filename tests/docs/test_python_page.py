"""The page on Python has every public name, and its examples run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import everplace
from everplace.render.render_config import render_config
from everplace.render.rendered_route import render_route

PAGE = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", everplace.__all__)
def test_every_public_name_is_on_the_page(name: str) -> None:
    assert re.search(rf"`{name}`", PAGE)
    assert name in ("Answer", "Describer", "Descriptors", "Frame", "Retrieval", "Route", "Scores", "Traverse") or any(
        f"ep.{name}" in example for example in EXAMPLES
    )


@pytest.mark.slow
def test_the_examples_run_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    world = render_config({"places": 40, "size": (64, 128), "conditions": ("summer", "winter")})
    render_route(tmp_path / "my-route", world, workers=1)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for example in EXAMPLES:
        if "runs/fabmap" not in example:  # which would have to be fitted
            exec(example.replace('"820:"', '"10:"'), names)
    assert len(names["answers"]) == len(names["path"]) == 30  # type: ignore[arg-type]
