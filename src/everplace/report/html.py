"""The builder of a report: sections of text, numbers, tables and pictures, written as one HTML file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from everplace.files import write_text
from everplace.report import blocks
from everplace.report.blocks import Best, Value, escaped

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from matplotlib.figure import Figure

__all__ = ["Report", "Section"]

# The browser itself refuses whatever the page, or the plotly inside it, might ask of a network.
_POLICY = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


class Section:
    """One section of a report; made by `Report.section`. Each method adds a block and returns the section.

    Attributes:
        title: The heading.
        anchor: The `id` of the section, unique in its report.
        has_charts: Whether it holds an interactive chart.
    """

    def __init__(self, title: str, anchor: str) -> None:
        self.title = title
        self.anchor = anchor
        self.has_charts = False
        self._blocks: list[str] = []

    def paragraph(self, text: str) -> Section:
        """Adds a paragraph of plain text."""
        self._blocks.append(f"<p>{escaped(text)}</p>")
        return self

    def folded(self, title: str, text: str) -> Section:
        """Adds a long text, such as a configuration, of which only the title shows until it is opened."""
        self._blocks.append(blocks.folded_block(title, text))
        return self

    def facts(self, facts: Mapping[str, Value], *, digits: int = 3) -> Section:
        """Adds headline numbers, each name above its value (floats with `digits` decimals)."""
        self._blocks.append(blocks.facts_block(facts, digits))
        return self

    def table(
        self,
        header: Sequence[str],
        rows: Sequence[Sequence[Value]],
        *,
        caption: str = "",
        best: Mapping[str, Best] | None = None,
        digits: int = 3,
    ) -> Section:
        """Adds a table; it scrolls sideways where the screen is narrow.

        Args:
            header: One name a column; the first column names the rows.
            rows: Values, one for each column; columns of numbers stand to the right.
            caption: Says what the table shows.
            best: For a column's name whether its "highest" or "lowest" number is the best and stands out;
                numbers that look the same on the page stand out together.
            digits: Decimals of floats.

        Raises:
            ConfigError: A row has another length than the header, or `best` names no column.
        """
        self._blocks.append(blocks.table_block(header, rows, caption=caption, best=best or {}, digits=digits))
        return self

    def figure(self, figure: Figure, *, alt: str, caption: str = "", dpi: float = 192.0) -> Section:
        """Adds a matplotlib figure, rendered now.

        Args:
            figure: What to show; one inch of it is 96 pixels of the page.
            alt: Says what it shows, for readers who cannot see it.
            caption: Written below.
            dpi: Pixels an inch, two for each of the page's; small drawings of lines become SVG instead.
        """
        self._blocks.append(blocks.figure_block(figure, alt=alt, caption=caption, dpi=dpi))
        return self

    def chart(self, figure: go.Figure, *, alt: str, caption: str = "") -> Section:
        """Adds an interactive plotly figure.

        Args:
            figure: What to show.
            alt: Says what it shows, for readers who cannot see it.
            caption: Written below.
        """
        self.has_charts = True
        self._blocks.append(blocks.chart_block(figure, alt=alt, caption=caption))
        return self

    def html(self) -> str:
        """Returns the section as HTML."""
        heading = f'<h2 id="{self.anchor}-heading">{escaped(self.title)}</h2>'
        inside = "\n".join([heading, *self._blocks])
        return f'<section id="{self.anchor}" aria-labelledby="{self.anchor}-heading">\n{inside}\n</section>'


class Report:
    """One self-contained HTML file: readable offline, on a phone, in the dark and on paper.

    All text is escaped. plotly's script (about 5 MB) is embedded once, and only when a section has a chart.

    Example:
        >>> report = Report("Comparison", details={"command": "everplace compare ..."})
        >>> rows = [["HOG", 0.589], ["SAD", 0.280]]
        >>> _ = report.section("Scores").table(["method", "recall@1"], rows, best={"recall@1": "highest"})
        >>> report.write(Path("report.html"))  # doctest: +SKIP
    """

    def __init__(self, title: str, *, subtitle: str = "", details: Mapping[str, str] | None = None) -> None:
        """Starts an empty report.

        Args:
            title: The heading of the page and the name of its window.
            subtitle: One sentence below it.
            details: Where the report comes from: names and values such as the command, the date, the version.
        """
        self.title = title
        self.subtitle = subtitle
        self.details = dict(details or {})
        self.sections: list[Section] = []

    def section(self, title: str) -> Section:
        """Adds a section and returns it, to be filled."""
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        taken = {section.anchor for section in self.sections}
        anchor, number = stem, 1
        while anchor in taken:
            number += 1
            anchor = f"{stem}-{number}"
        section = Section(title, anchor)
        self.sections.append(section)
        return section

    def html(self) -> str:
        """Returns the whole page."""
        style = _asset("page.css")
        scripts = _scripts() if any(section.has_charts for section in self.sections) else ""
        sections = "\n".join(section.html() for section in self.sections)
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escaped(self.title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
            f'<div class="page">\n{self._header()}\n<div class="body">\n{self._contents()}\n'
            f"<main>\n{sections}\n</main>\n</div>\n</div>\n{scripts}</body>\n</html>\n"
        )

    def write(self, path: Path) -> None:
        """Writes the page whole.

        Args:
            path: The file to create or replace.

        Raises:
            StorageError: It cannot be written.
        """
        write_text(path, self.html())

    def _header(self) -> str:
        subtitle = f'<p class="subtitle">{escaped(self.subtitle)}</p>' if self.subtitle else ""
        items = "".join(f"<dt>{escaped(name)}</dt><dd>{escaped(text)}</dd>" for name, text in self.details.items())
        details = f'<dl class="details">{items}</dl>' if items else ""
        return f"<header>\n<h1>{escaped(self.title)}</h1>\n{subtitle}\n{details}\n</header>"

    def _contents(self) -> str:
        """The table of contents; one section needs none."""
        if len(self.sections) < 2:
            return ""
        items = "".join(
            f'<li><a href="#{section.anchor}">{escaped(section.title)}</a></li>' for section in self.sections
        )
        return f'<nav aria-labelledby="contents"><h2 id="contents">Contents</h2><ol>{items}</ol></nav>'


def _scripts() -> str:
    """Returns plotly's script and the few lines that draw the charts with it."""
    from plotly.offline import get_plotlyjs

    return f"<script>{get_plotlyjs()}</script>\n<script>\n{_asset('charts.js')}</script>\n"


def _asset(name: str) -> str:
    """Reads a file that lies beside this module."""
    return resources.files("everplace.report").joinpath(name).read_text(encoding="utf-8")
