"""The builder of a report: sections of text, numbers, tables and pictures, written as one HTML file."""

from __future__ import annotations

import base64
import gzip
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from everplace.errors import ConfigError
from everplace.files import write_text
from everplace.plots.canvas import palette_png_bytes, svg_bytes, webp_bytes
from everplace.report.table_cells import Best, Value, formatted, table_cells

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from matplotlib.figure import Figure

__all__ = ["Report", "Section"]

_TEMPLATES = Environment(
    loader=PackageLoader("everplace.report"), autoescape=True, trim_blocks=True, undefined=StrictUndefined
)

_MOST_SVG = 100_000
"""A larger drawing of lines is embedded as pixels: a file of many panels has to open quickly on a phone."""


class Section:
    """One section of a report; made by `Report.section`. Each method adds a block and returns the section.

    Attributes:
        title: The heading.
        anchor: The `id` of the section, unique in its report.
        blocks: What it holds, as HTML.
        has_charts: Whether it holds an interactive chart.
    """

    def __init__(self, title: str, anchor: str) -> None:
        self.title = title
        self.anchor = anchor
        self.blocks: list[Markup] = []
        self.has_charts = False

    def paragraph(self, text: str) -> Section:
        """Adds a paragraph of plain text."""
        return self._add("paragraph", text=text)

    def folded(self, title: str, text: str) -> Section:
        """Adds a long text, such as a configuration, of which only the title shows until it is opened."""
        return self._add("folded", title=title, text=text)

    def facts(self, facts: Mapping[str, Value], *, digits: int = 3) -> Section:
        """Adds headline numbers, each name above its value (floats with `digits` decimals)."""
        return self._add("facts", facts={name: formatted(value, digits) for name, value in facts.items()})

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
        best = best or {}
        if not set(best) <= set(header) or any(len(row) != len(header) for row in rows):
            raise ConfigError(
                f"cannot make the table {caption!r}; give rows of {len(header)} values and name columns as best"
            )
        heads, cells = table_cells(header, rows, best, digits)
        return self._add("table", heads=heads, rows=cells, caption=caption)

    def figure(
        self, figure: Figure, *, alt: str, caption: str = "", dpi: float = 192.0, photos: bool = False
    ) -> Section:
        """Adds a matplotlib figure, rendered now.

        Args:
            figure: What to show; one inch of it is 96 pixels of the page.
            alt: Says what it shows, for readers who cannot see it.
            caption: Written below.
            dpi: Pixels an inch, two for each of the page's; small drawings of lines become SVG instead.
            photos: Whether it holds photographs, which become WebP; other pixels become PNG of 256 colours.
        """
        width, height = (round(96 * inches) for inches in figure.get_size_inches())
        data = b"" if photos or any(axes.images for axes in figure.axes) else svg_bytes(figure)
        kind = "image/svg+xml"
        if photos:
            kind, data = "image/webp", webp_bytes(figure, dpi)
        elif not data or len(data) > _MOST_SVG:
            kind, data = "image/png", palette_png_bytes(figure, dpi)
        source = f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
        return self._add("figure", source=source, alt=alt, caption=caption, width=width, height=height)

    def chart(self, figure: go.Figure, *, alt: str, caption: str = "") -> Section:
        """Adds an interactive plotly figure: its data, beside the place where `charts.js` draws it.

        Args:
            figure: What to show.
            alt: Says what it shows, for readers who cannot see it.
            caption: Written below.
        """
        self.has_charts = True
        # In a script element only "<" could end the data or open a comment; in JSON it may be written so.
        data = Markup(str(figure.to_json()).replace("<", "\\u003c"))
        return self._add("chart", data=data, alt=alt, caption=caption, height=int(figure.layout.height or 450))

    def _add(self, macro: str, **values: Any) -> Section:
        self.blocks.append(getattr(_TEMPLATES.get_template("blocks.html").module, macro)(**values))
        return self


class Report:
    """One self-contained HTML file: readable offline, on a phone, in the dark and on paper.

    All text is escaped. plotly's script (5 MB, packed 2 MB) is embedded once, and only when a section has a chart.

    Example:
        >>> report = Report("Comparison", details={"command": "everplace compare ..."})
        >>> rows = [["HOG", 0.589], ["SAD", 0.280]]
        >>> _ = report.section("Scores").table(["method", "recall@1"], rows, best={"recall@1": "highest"})
        >>> report.write(Path("report.html"))  # doctest: +SKIP
    """

    def __init__(
        self, title: str, *, subtitle: str = "", lead: str = "", details: Mapping[str, str] | None = None
    ) -> None:
        """Starts an empty report.

        Args:
            title: The heading of the page and the name of its window.
            subtitle: One sentence below it.
            lead: What the report says, in a sentence or two.
            details: Where the report comes from: names and values such as the command, the date, the version.
        """
        self.title = title
        self.subtitle = subtitle
        self.lead = lead
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
        """Returns the whole page; bytes of a file name that are no UTF-8 stay readable."""
        plotly = _packed_plotly() if any(section.has_charts for section in self.sections) else ""
        page = _TEMPLATES.get_template("page.html").render(
            title=self.title,
            subtitle=self.subtitle,
            lead=self.lead,
            details=self.details,
            sections=self.sections,
            plotly=plotly,
        )
        return page.encode("utf-8", "backslashreplace").decode("utf-8")

    def write(self, path: Path) -> None:
        """Writes the page whole.

        Args:
            path: The file to create or replace.

        Raises:
            StorageError: It cannot be written.
        """
        write_text(path, self.html())


def _packed_plotly() -> str:
    """Plotly's script as base64 of gzip, which `charts.js` unpacks."""
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode("ascii")
