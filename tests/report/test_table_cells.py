"""How a table shows its values."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from everplace.errors import ConfigError
from everplace.report.html import Report
from everplace.report.table_cells import Value, formatted

DASH = "\N{EN DASH}"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, DASH), (float("nan"), DASH), ("a<b", "a<b"), (True, "yes"), (2002, "2,002"), (0.58949, "0.589"),
        (np.float64(0.5), "0.500"), (-1.0, "-1.000"), (0, "0"),
    ],
)  # fmt: skip
def test_formatted(value: Value, text: str) -> None:
    assert formatted(value) == text


def table(header: list[str], rows: list[list[Value]], **options: Any) -> str:
    """A table as a section holds it."""
    return Report("r").section("s").table(header, rows, **options).blocks[-1]


def test_numpy_scalars_are_numbers() -> None:
    rows: list[list[Value]] = [["a", np.float32(0.5), np.int64(2)], ["b", np.float32(0.25), np.int64(1000)]]
    shown = table(["m", "x", "n"], rows, caption="", best={"x": "highest", "n": "highest"}, digits=2)
    assert re.findall("<strong>(.*?)</strong>", shown) == ["0.50", "1,000"]


def _row(table: str, name: str) -> str:
    rows: list[str] = re.findall(r"<tr>.*?</tr>", table)
    (row,) = (row for row in rows if f">{name}<" in row)
    return row


def test_table_heads_numbers_and_best() -> None:
    shown = table(
        ["method", "recall@1", "ms", "note"],
        [["hog", 0.589, 2, ""], ["sad", 0.28, 1, ""], ["dino", None, float("nan"), "weights <absent>"]],
        caption="Scores & times",
        best={"recall@1": "highest", "ms": "lowest"},
        digits=3,
    )
    assert '<th scope="col">method</th><th scope="col" class="number">recall@1</th>' in shown
    assert '<td class="number best"><strong>0.589</strong></td><td class="number">2</td>' in _row(shown, "hog")
    assert '<td class="number">0.280</td><td class="number best"><strong>1</strong></td>' in _row(shown, "sad")
    assert '<th scope="row">dino</th>' in shown
    assert "best" not in _row(shown, "dino")
    assert "weights &lt;absent&gt;" in shown
    assert "<caption>Scores &amp; times</caption>" in shown


def test_what_looks_the_same_is_best_together() -> None:
    shown = table(
        ["method", "auc"],
        [["a", 0.4021], ["b", 0.4019], ["c", 0.4]],
        caption="",
        best={"auc": "highest"},
        digits=3,
    )
    assert shown.count("<strong>0.402</strong>") == 2
    assert "<strong>0.400" not in shown


def test_a_column_without_numbers_has_no_best() -> None:
    shown = table(["m", "auc"], [["a", None], ["b", float("nan")]], caption="", best={"auc": "lowest"}, digits=3)
    assert "<strong>" not in shown


def test_a_long_text_gets_room_and_an_empty_table_keeps_its_head() -> None:
    shown = table(["m", "note"], [["a", "x" * 40]], caption="", best={}, digits=3)
    assert '<th scope="col" class="long">note</th>' in shown
    assert table(["m"], [], caption="", best={"m": "highest"}, digits=3).count("<tr>") == 1


@pytest.mark.parametrize(("rows", "best"), [([["a"]], {}), ([["a", 1]], {"other": "highest"})])
def test_a_table_that_does_not_fit_together_is_refused(rows: list[list[Value]], best: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"'Scores'.*2 values"):
        table(["m", "n"], rows, caption="Scores", best=best, digits=3)
