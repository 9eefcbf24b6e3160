"""The parts of a report as HTML: pure functions from values to text, every text escaped."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard

import numpy as np

from everplace.errors import ConfigError
from everplace.plots.canvas import png_bytes, svg_bytes

if TYPE_CHECKING:
    import plotly.graph_objects as go
    from matplotlib.figure import Figure

__all__ = [
    "Best",
    "Value",
    "chart_block",
    "escaped",
    "facts_block",
    "figure_block",
    "folded_block",
    "formatted",
    "table_block",
]

Number: TypeAlias = int | float | np.integer[Any] | np.floating[Any]
Value: TypeAlias = str | Number | None
"""What a table's cell or a fact holds; None and NaN are shown as a dash."""

Best: TypeAlias = Literal["highest", "lowest"]

_MOST_SVG = 150_000
"""A larger drawing of lines is embedded as pixels: a file of many panels has to open quickly on a phone."""


_LONG = 28
"""A text with more characters than this may break into lines."""


def escaped(text: str) -> str:
    """Makes a text safe in HTML and in an attribute; bytes of a file name that are no UTF-8 stay readable."""
    return html.escape(text.encode("utf-8", "backslashreplace").decode("utf-8"), quote=True)


def formatted(value: Value, digits: int = 3) -> str:
    """Writes a value as plain text.

    Args:
        value: Integers get thousands separators, floats `digits` decimals, None and NaN a dash.
        digits: Decimals of a float.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not _is_number(value):
        return "\N{EN DASH}"
    return f"{value:,}" if isinstance(value, int | np.integer) else f"{value:,.{digits}f}"


def facts_block(facts: Mapping[str, Value], digits: int = 3) -> str:
    """Headline numbers: each name above its value."""
    items = (
        f"<div><dt>{escaped(name)}</dt><dd>{escaped(formatted(value, digits))}</dd></div>"
        for name, value in facts.items()
    )
    return f'<dl class="facts">{"".join(items)}</dl>'


def table_block(
    header: Sequence[str],
    rows: Sequence[Sequence[Value]],
    *,
    caption: str,
    best: Mapping[str, Best],
    digits: int,
) -> str:
    """A table whose first column names the rows; see `report.html.Section.table`."""
    unknown = [name for name in best if name not in header]
    if unknown or any(len(row) != len(header) for row in rows):
        raise ConfigError(
            f"cannot make the table {caption!r}; give rows of {len(header)} values and name columns as best"
        )
    columns = list(zip(*rows, strict=True)) if rows else [() for _ in header]
    looks = [_look(column) for column in columns]
    winners = [
        _winners(column, best[name], digits) if name in best else frozenset[str]()
        for name, column in zip(header, columns, strict=True)
    ]
    heads = "".join(
        f'<th scope="col"{_class(look)}>{escaped(name)}</th>' for name, look in zip(header, looks, strict=True)
    )
    lines = []
    for row in rows:
        cells = []
        for place, (value, look, winning) in enumerate(zip(row, looks, winners, strict=True)):
            text = formatted(value, digits)
            won = _is_number(value) and text in winning
            shown = f"<strong>{escaped(text)}</strong>" if won else escaped(text)
            attributes = _class(f"{look} best".strip() if won else look)
            cells.append(f'<th scope="row"{attributes}>{shown}</th>' if place == 0 else f"<td{attributes}>{shown}</td>")
        lines.append(f"<tr>{''.join(cells)}</tr>")
    title = f"<caption>{escaped(caption)}</caption>" if caption else ""
    # A region that scrolls must be reachable with the keyboard, and then it needs a name.
    return (
        f'<div class="scroll table" role="region" tabindex="0" aria-label="{escaped(caption or "table")}">'
        f"<table>{title}<thead><tr>{heads}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>"
    )


def figure_block(figure: Figure, *, alt: str, caption: str, dpi: float) -> str:
    """A matplotlib figure: as SVG when it holds only lines and is small, else as PNG."""
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    kind, data = "image/png", b""
    if not any(axes.images for axes in figure.axes):
        kind, data = "image/svg+xml", svg_bytes(figure)
    if not data or len(data) > _MOST_SVG:
        kind, data = "image/png", png_bytes(figure, dpi)
    source = f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
    return (
        f'<figure><img src="{source}" alt="{escaped(alt)}" width="{width}" height="{height}">'
        f"{_caption(caption)}</figure>"
    )


def chart_block(figure: go.Figure, *, alt: str, caption: str) -> str:
    """A plotly figure: its data beside the place where `charts.js` draws it."""
    # In a script element only "<" could end the data or open a comment; in JSON it may be written so.
    data = str(figure.to_json()).replace("<", "\\u003c")
    height = int(figure.layout.height or 450)
    return (
        f'<figure><div class="chart"><script type="application/json">{data}</script>'
        f'<div class="plot" role="img" aria-label="{escaped(alt)}" style="min-height:{height}px"></div></div>'
        "<noscript><p>This chart needs JavaScript; it asks nothing from the network.</p></noscript>"
        f"{_caption(caption)}</figure>"
    )


def folded_block(title: str, text: str) -> str:
    """A long text as it is, which opens when its title is chosen."""
    return f"<details><summary>{escaped(title)}</summary><pre>{escaped(text)}</pre></details>"


def _caption(text: str) -> str:
    return f"<figcaption>{escaped(text)}</figcaption>" if text else ""


def _class(names: str) -> str:
    return f' class="{names}"' if names else ""


def _is_number(value: Value) -> TypeGuard[Number]:
    """Whether a value can be compared: numpy's numbers can, truth values and NaN cannot."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and not math.isnan(value)


def _look(column: Sequence[Value]) -> str:
    """The class of a column's cells: numbers (and dashes) stand to the right, sentences get room."""
    texts = [value for value in column if isinstance(value, str)]
    if not texts:
        return "number" if column else ""
    return "long" if max(map(len, texts)) > _LONG else ""


def _winners(column: Sequence[Value], best: Best, digits: int) -> frozenset[str]:
    """The best value as it is shown: what cannot be told apart on the page wins together."""
    shown = {float(value): formatted(value, digits) for value in column if _is_number(value)}
    if not shown:
        return frozenset()
    return frozenset({shown[max(shown) if best == "highest" else min(shown)]})
