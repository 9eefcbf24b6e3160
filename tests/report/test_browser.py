"""The report in a real browser that has no network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
import pytest

from everplace.plots.canvas import new_axes
from everplace.report.html import Report

if TYPE_CHECKING:
    from playwright.sync_api import Browser


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    page = Report("Comparison", subtitle="of two methods", details={"command": "everplace compare " + "x" * 300})
    lines, axes = new_axes(8, 4)
    axes.plot([0, 1])
    cells, other = new_axes(8, 4)
    other.imshow(np.eye(3))
    plot = go.Figure([go.Scatter(x=[0, 1], y=[1, 0.5], name=name) for name in ("hog", "sad")])
    header = ["method", *(f"column {number}" for number in range(12))]
    section = page.section("Scores")
    section.table(header, [["hog", *range(12)]]).chart(plot, alt="curves").chart(plot, alt="again")
    page.section("Pictures").figure(lines, alt="a line").figure(cells, alt="cells")
    path = tmp_path_factory.mktemp("report") / "report.html"
    page.write(path)
    return path


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_page_opens_offline(browser: Browser, report: Path, scheme: Any, width: int) -> None:
    context = browser.new_context(offline=True, color_scheme=scheme, viewport={"width": width, "height": 800})
    page = context.new_page()
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(report.as_uri())
    page.wait_for_selector(".plot .scatterlayer .trace path.js-line")
    assert complaints == []
    assert [url for url in requests if not url.startswith(("data:", "blob:"))] == [report.as_uri()]
    assert page.locator(".plot").count() == 2
    # Two lines in each of two charts, visible.
    assert page.locator(".plot .scatterlayer .trace").count() == 4
    for chart in page.locator(".plot .main-svg").all()[:1]:
        box = chart.bounding_box()
        assert box is not None
        assert min(box["width"], box["height"]) > 200
    sizes = page.evaluate("[...document.images].map(i => [i.naturalWidth, i.naturalHeight, i.clientWidth])")
    assert len(sizes) == 2
    assert all(min(size) > 0 for size in sizes)
    # The page itself never scrolls sideways; wide tables do so inside their own frames, and pictures are whole.
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for picture in page.locator("figure img, .plot .main-svg").all():
        box = picture.bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    ink = page.evaluate("getComputedStyle(document.querySelector('.xtick text')).fill")
    assert ink == page.evaluate("getComputedStyle(document.body).color")
    context.close()


@pytest.mark.parametrize(("width", "scrolls"), [(400, True), (1280, False), (1400, False)])
def test_no_column_of_a_comparison_is_lost(browser: Browser, tmp_path: Path, width: int, scrolls: bool) -> None:
    header = [
        "method", "recall@1", "recall@5", "recall@10", "auc_pr", "AP", "R@100%P", "EP", "dimension", "bytes",
        "ms/image", "peak MB",
    ]  # fmt: skip
    page = Report("Comparison")
    page.section("Scores").table(header, [["cp-vae-best", *[0.123] * 7, 3780, 15120, 12.345, 1234]])
    page.section("More").paragraph("A second section brings the contents, which take room.")
    page.write(tmp_path / "report.html")
    context = browser.new_context(offline=True, viewport={"width": width, "height": 800})
    shown = context.new_page()
    shown.goto((tmp_path / "report.html").as_uri())
    frame = shown.locator(".table")
    assert frame.evaluate("e => e.scrollWidth > e.clientWidth") is scrolls
    # Scrolled to its end, the frame shows the last column whole.
    frame.evaluate("e => { e.scrollLeft = e.scrollWidth; }")
    # The names of the rows and their head stay in sight.
    heads = [shown.locator(place).first.bounding_box() for place in ("thead th", "tbody th")]
    assert [head["x"] for head in heads if head is not None] == pytest.approx(
        [frame.evaluate("e => e.getBoundingClientRect().x")] * 2
    )
    outer, last = frame.bounding_box(), shown.locator("thead th").last.bounding_box()
    assert outer is not None
    assert last is not None
    assert last["x"] + last["width"] <= outer["x"] + outer["width"] + 0.5
    context.close()
