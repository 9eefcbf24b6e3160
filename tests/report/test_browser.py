"""The report in a real browser that has no network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go
import pytest

from everplace.plots.canvas import new_axes
from everplace.report.html import Report

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CHROMIUM = Path("/usr/bin/chromium")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install 'everplace[dev]'")
    if not CHROMIUM.exists():
        pytest.skip(f"{CHROMIUM} is not there: install the chromium package")
    with api.sync_playwright() as playwright:
        started = playwright.chromium.launch(
            executable_path=str(CHROMIUM),
            args=["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
        )
        yield started
        started.close()


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
    # The page itself never scrolls sideways; wide tables and pictures do so inside their own frames.
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    ink = page.evaluate("getComputedStyle(document.querySelector('.xtick text')).fill")
    assert ink == page.evaluate("getComputedStyle(document.body).color")
    context.close()
