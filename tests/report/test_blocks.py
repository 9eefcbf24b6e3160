from __future__ import annotations

import base64
import io
import re

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image as PillowImage

from everplace.errors import ConfigError
from everplace.plots.canvas import new_axes
from everplace.report.blocks import (
    Value,
    chart_block,
    escaped,
    facts_block,
    figure_block,
    formatted,
    table_block,
)

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


def test_numpy_scalars_are_numbers() -> None:
    rows: list[list[Value]] = [["a", np.float32(0.5), np.int64(2)], ["b", np.float32(0.25), np.int64(1000)]]
    table = table_block(["m", "x", "n"], rows, caption="", best={"x": "highest", "n": "highest"}, digits=2)
    assert re.findall("<strong>(.*?)</strong>", table) == ["0.50", "1,000"]


def test_escaped_text_is_safe_everywhere_and_always_encodable() -> None:
    assert escaped('<a href="x">&\'') == "&lt;a href=&quot;x&quot;&gt;&amp;&#x27;"
    assert escaped("frame\udcff.png").encode("utf-8") == b"frame\\udcff.png"


def _row(table: str, name: str) -> str:
    rows: list[str] = re.findall(r"<tr>.*?</tr>", table)
    (row,) = (row for row in rows if f">{name}<" in row)
    return row


def test_table_heads_numbers_and_best() -> None:
    table = table_block(
        ["method", "recall@1", "ms", "note"],
        [["hog", 0.589, 2, ""], ["sad", 0.28, 1, ""], ["dino", None, float("nan"), "weights <absent>"]],
        caption="Scores & times",
        best={"recall@1": "highest", "ms": "lowest"},
        digits=3,
    )
    assert '<th scope="col">method</th><th scope="col" class="number">recall@1</th>' in table
    assert '<td class="number best"><strong>0.589</strong></td><td class="number">2</td>' in _row(table, "hog")
    assert '<td class="number">0.280</td><td class="number best"><strong>1</strong></td>' in _row(table, "sad")
    assert '<th scope="row">dino</th>' in table
    assert "best" not in _row(table, "dino")
    assert "weights &lt;absent&gt;" in table
    assert "<caption>Scores &amp; times</caption>" in table


def test_what_looks_the_same_is_best_together() -> None:
    table = table_block(
        ["method", "auc"],
        [["a", 0.4021], ["b", 0.4019], ["c", 0.4]],
        caption="",
        best={"auc": "highest"},
        digits=3,
    )
    assert table.count("<strong>0.402</strong>") == 2
    assert "<strong>0.400" not in table


def test_a_column_without_numbers_has_no_best() -> None:
    table = table_block(["m", "auc"], [["a", None], ["b", float("nan")]], caption="", best={"auc": "lowest"}, digits=3)
    assert "<strong>" not in table


def test_a_long_text_gets_room_and_an_empty_table_keeps_its_head() -> None:
    table = table_block(["m", "note"], [["a", "x" * 40]], caption="", best={}, digits=3)
    assert '<th scope="col" class="long">note</th>' in table
    assert table_block(["m"], [], caption="", best={"m": "highest"}, digits=3).count("<tr>") == 1


@pytest.mark.parametrize(("rows", "best"), [([["a"]], {}), ([["a", 1]], {"other": "highest"})])
def test_a_table_that_does_not_fit_together_is_refused(rows: list[list[Value]], best: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"'Scores'.*2 values"):
        table_block(["m", "n"], rows, caption="Scores", best=best, digits=3)  # type: ignore[arg-type]


def test_facts_pair_names_with_values() -> None:
    assert facts_block({"queries": 2002, "a<b": 0.12345}, digits=2) == (
        '<dl class="facts"><div><dt>queries</dt><dd>2,002</dd></div><div><dt>a&lt;b</dt><dd>0.12</dd></div></dl>'
    )


def _embedded(block: str) -> tuple[str, bytes]:
    (found,) = re.findall(r'src="data:([^;]+);base64,([^"]+)"', block)
    return found[0], base64.b64decode(found[1])


def test_lines_become_svg_and_images_png_at_twice_the_size() -> None:
    figure, axes = new_axes(4, 3)
    axes.plot([0, 1])
    kind, data = _embedded(figure_block(figure, alt='a "line"', caption="Line <1>", dpi=192))
    assert kind == "image/svg+xml"
    assert b"<svg" in data
    axes.imshow(np.eye(3))
    block = figure_block(figure, alt='a "line"', caption="Line <1>", dpi=192)
    kind, data = _embedded(block)
    assert kind == "image/png"
    with PillowImage.open(io.BytesIO(data)) as picture:
        assert picture.size == (768, 576)
    assert 'width="384" height="288"' in block
    assert 'alt="a &quot;line&quot;"' in block
    assert "<figcaption>Line &lt;1&gt;</figcaption>" in block


def test_a_heavy_drawing_of_lines_becomes_png() -> None:
    figure, axes = new_axes(4, 3)
    rng = np.random.default_rng(0)
    for _ in range(20):
        axes.plot(rng.random(1000))
    assert _embedded(figure_block(figure, alt="a", caption="", dpi=96))[0] == "image/png"


def test_chart_data_cannot_end_its_script() -> None:
    block = chart_block(go.Figure(go.Scatter(x=[0], y=[1], name="</script><!--")), alt="<alt>", caption="")
    assert block.count("</script>") == 1
    assert "<!--" not in block
    assert 'aria-label="&lt;alt&gt;"' in block
