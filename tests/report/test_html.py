from __future__ import annotations

import base64
import gzip
import html.parser
import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest
from PIL import Image as PillowImage

from everplace.errors import StorageError
from everplace.plots.canvas import new_axes, png_bytes
from everplace.plots.similarity_matrix import draw_similarity
from everplace.report.html import Report, Section

VOID = {"meta", "img", "link", "br", "hr", "input"}
PLOTLY = "plotly.js v"


class Page(html.parser.HTMLParser):
    """Reads a page strictly: every element that opens is closed, in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: dict[str, list[str]] = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and data.strip():
            self.words.setdefault(self.open[-1], []).append(data)

    def attributes(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def full_report(charts: int = 2) -> Report:
    report = Report(
        'Scores <script>alert("1")</script>', subtitle="a & b", details={"command": "everplace compare <x>"}
    )
    section = report.section("Scores & more")
    section.paragraph("<b>text</b>").facts({"queries": 3})
    section.table(["method", "auc"], [["<i>", 0.5]], caption="All", best={"auc": "highest"})
    figure, axes = new_axes(3, 2)
    axes.imshow(np.eye(4))
    report.section("Scores, more").figure(figure, alt="four cells", caption="Cells")
    for number in range(charts):
        plot = go.Figure(go.Scatter(x=[0, 1], y=[1, 0], name=f"line {number}"), layout={"template": "none"})
        section.chart(plot, alt=f"chart {number}", caption="A line")
    return report


def test_page_is_balanced_and_says_what_was_given() -> None:
    page = Page(full_report().html())
    for tag in ("main", "header", "nav", "h1", "title"):
        assert len(page.attributes(tag)) == 1, tag
    assert page.words["h1"] == page.words["title"] == ['Scores <script>alert("1")</script>']
    assert (
        page.words["p"]
        == ["a & b", "<b>text</b>"] + ["This chart needs JavaScript; it asks nothing from the network."] * 2
    )
    assert "everplace compare <x>" in page.words["dd"]
    assert page.attributes("html") == [{"lang": "en"}]
    assert all(image["alt"] for image in page.attributes("img"))
    assert len(page.attributes("figure")) == len(page.words["figcaption"]) == 3
    assert {head["scope"] for head in page.attributes("th")} == {"row", "col"}
    assert "i" not in page.words


def test_contents_lead_to_every_section_once() -> None:
    report = full_report()
    report.section("Scores & more")
    report.section("冬")
    page = Page(report.html())
    anchors = [section["id"] for section in page.attributes("section")]
    assert anchors == ["scores-more", "scores-more-2", "scores-more-3", "section"]
    assert [link["href"] for link in page.attributes("a")] == [f"#{anchor}" for anchor in anchors]
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    labels = [section["aria-labelledby"] for section in page.attributes("section")]
    assert set(labels) <= set(ids)


def test_nothing_is_taken_from_a_network() -> None:
    page = Page(full_report().html())
    for tag, attributes in page.elements:
        for name in ("src", "href", "data", "poster", "srcset", "action"):
            target = attributes.get(name)
            assert target is None or target.startswith(("data:", "#")), (tag, target)
    assert page.attributes("link") == []
    (policy,) = (meta["content"] for meta in page.attributes("meta") if "http-equiv" in meta)
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    style = "".join(page.words["style"])
    assert "url(" not in style
    assert "@import" not in style


@pytest.mark.parametrize(("charts", "copies"), [(0, 0), (1, 1), (3, 1)])
def test_plotly_is_there_once_or_not_at_all(charts: int, copies: int) -> None:
    text = full_report(charts).html()
    packed = re.findall(r'<script type="application/gzip" id="plotly">([^<]*)</script>', text)
    assert [gzip.decompress(base64.b64decode(one)).decode().count(PLOTLY) for one in packed] == [1] * copies
    assert text.count('<script type="application/json">') == charts
    assert (1_000_000 < len(text) < 2_500_000) == bool(copies)


def test_a_report_without_charts_never_imports_plotly() -> None:
    code = (
        "import sys\n"
        "from everplace.report.html import Report\n"
        "report = Report('a'); report.section('b').paragraph('c'); report.html()\n"
        "assert 'plotly' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def test_empty_report_is_a_page_without_contents() -> None:
    page = Page(Report("Nothing").html())
    assert page.attributes("nav") == []
    assert page.words["h1"] == ["Nothing"]


def test_report_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "report.html"
    report = Report("frame\udcff")
    report.write(path)
    first = path.read_text(encoding="utf-8")
    assert first == report.html()
    report.section("More")
    report.write(path)
    assert "More" in path.read_text(encoding="utf-8")
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]
    with pytest.raises(StorageError, match="report"):
        report.write(path / "below-a-file.html")


def test_light_dark_phone_and_paper_have_their_rules() -> None:
    style = "".join(Page(Report("a").html()).words["style"])
    for rule in ("prefers-color-scheme: dark", "max-width: 40rem", "@media print"):
        assert rule in style
    assert style.count("{") == style.count("}")


def test_a_folded_text_is_whole_and_escaped() -> None:
    report = Report("R")
    report.section("How").folded("Manifest <1>", '{\n  "a": "<b>"\n}')
    page = Page(report.html())
    assert page.words["summary"] == ["Manifest <1>"]
    assert page.words["pre"] == ['{\n  "a": "<b>"\n}']
    assert page.attributes("details") == [{}]


def section() -> Section:
    return Report("r").section("s")


def test_any_name_can_be_written() -> None:
    report = Report("R", details={"frame\udcff": '<a href="x">&\''})
    report.section("S").paragraph("frame\udcff.png")
    page = Page(report.html().encode("utf-8").decode("utf-8"))
    assert page.words["dt"] == [r"frame\udcff"]
    assert page.words["dd"] == ['<a href="x">&\'']
    assert page.words["p"] == [r"frame\udcff.png"]


def test_facts_pair_names_with_values() -> None:
    assert section().facts({"queries": 2002, "a<b": 0.12345}, digits=2).blocks == [
        '<dl class="facts"><div><dt>queries</dt><dd>2,002</dd></div><div><dt>a&lt;b</dt><dd>0.12</dd></div></dl>'
    ]


def _embedded(block: str) -> tuple[str, bytes]:
    (found,) = re.findall(r'src="data:([^;]+);base64,([^"]+)"', block)
    return found[0], base64.b64decode(found[1])


def test_lines_become_svg_and_images_png_at_twice_the_size() -> None:
    figure, axes = new_axes(4, 3)
    axes.plot([0, 1])
    kind, data = _embedded(section().figure(figure, alt='a "line"', caption="Line <1>").blocks[0])
    assert kind == "image/svg+xml"
    assert b"<svg" in data
    axes.imshow(np.eye(3))
    block = section().figure(figure, alt='a "line"', caption="Line <1>").blocks[0]
    kind, data = _embedded(block)
    assert kind == "image/png"
    with PillowImage.open(io.BytesIO(data)) as picture:
        assert picture.size == (768, 576)
    assert 'width="384" height="288"' in block
    assert 'alt="a &#34;line&#34;"' in block
    assert "<figcaption>Line &lt;1&gt;</figcaption>" in block


def test_a_heavy_drawing_of_lines_becomes_png() -> None:
    figure, axes = new_axes(4, 3)
    rng = np.random.default_rng(0)
    for _ in range(20):
        axes.plot(rng.random(1000))
    assert _embedded(section().figure(figure, alt="a", dpi=96).blocks[0])[0] == "image/png"


@pytest.mark.parametrize(("size", "dpi"), [((64, 128), 192), ((300, 400), 192), ((300, 400), 96)])
def test_photographs_become_webp_of_a_fraction_of_the_bytes(size: tuple[int, int], dpi: int) -> None:
    figure, axes = new_axes(4, 3)
    rng = np.random.default_rng(0)
    scene = np.cumsum(np.cumsum(rng.normal(size=(*size, 3)), axis=0), axis=1)
    axes.imshow((255 * (scene - scene.min()) / np.ptp(scene)).astype(np.uint8) // 2 + rng.integers(0, 20, (*size, 3)))
    kind, small = _embedded(section().figure(figure, alt="a", dpi=dpi, photos=True).blocks[0])
    large = png_bytes(figure, dpi)
    assert kind == "image/webp"
    assert len(small) < len(large) / 2
    with PillowImage.open(io.BytesIO(small)) as picture, PillowImage.open(io.BytesIO(large)) as whole:
        assert picture.size == whole.size == (4 * dpi, 3 * dpi)
        off = np.asarray(picture.convert("RGB"), np.float64) - np.asarray(whole.convert("RGB"), np.float64)
    assert np.abs(off).mean() < 6


def test_chart_data_cannot_end_its_script() -> None:
    block = section().chart(go.Figure(go.Scatter(x=[0], y=[1], name="</script><!--")), alt="<alt>").blocks[0]
    assert block.count("</script>") == 1
    assert "<!--" not in block
    assert 'aria-label="&lt;alt&gt;"' in block


@pytest.mark.parametrize("shape", [(140, 140), (40, 40), (300, 100)])
def test_a_matrix_keeps_its_colours_in_a_fraction_of_the_bytes(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    figure, axes = new_axes(6, 5)
    draw_similarity(axes, rng.random(shape), query="q", database="d", title="t", mark_best=True)
    kind, data = _embedded(section().figure(figure, alt="a").blocks[0])
    whole = png_bytes(figure)
    assert kind == "image/png"
    assert len(data) < len(whole) / 2
    with PillowImage.open(io.BytesIO(data)) as picture, PillowImage.open(io.BytesIO(whole)) as exact:
        off = np.asarray(picture.convert("RGB"), np.int64) - np.asarray(exact.convert("RGB"), np.int64)
    assert np.abs(off).max() <= 24
    assert np.abs(off).mean() < 2
