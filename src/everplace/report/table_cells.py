"""How the values of a table or a fact are shown, and which of a column stand out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias, TypeGuard

import numpy as np

__all__ = ["Best", "TableCell", "Value", "formatted", "table_cells"]

Number: TypeAlias = int | float | np.integer[Any] | np.floating[Any]
Value: TypeAlias = str | Number | None
"""What a table's cell or a fact holds; None and NaN are shown as a dash."""

Best: TypeAlias = Literal["highest", "lowest"]

_LONG = 28
"""A text with more characters than this may break into lines."""


class TableCell(NamedTuple):
    """A cell as it is shown: `look` is "number", "long" or empty."""

    text: str
    look: str
    best: bool = False


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


def table_cells(
    header: Sequence[str], rows: Sequence[Sequence[Value]], best: Mapping[str, Best], digits: int
) -> tuple[list[TableCell], list[list[TableCell]]]:
    """The cells of a table's head and of its rows; arguments as for `everplace.report.html.Section.table`."""
    columns = list(zip(*rows, strict=True)) if rows else [() for _ in header]
    looks = [_look(column) for column in columns]
    winners = [
        _winners(column, best[name], digits) if name in best else frozenset[str]()
        for name, column in zip(header, columns, strict=True)
    ]
    shown = [
        [
            TableCell(text := formatted(value, digits), look, _is_number(value) and text in winning)
            for value, look, winning in zip(row, looks, winners, strict=True)
        ]
        for row in rows
    ]
    return list(map(TableCell, header, looks)), shown


def _is_number(value: Value) -> TypeGuard[Number]:
    """Whether a value can be compared: numpy's numbers can, truth values and NaN cannot."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool) and not math.isnan(value)


def _look(column: Sequence[Value]) -> str:
    """How a column looks: numbers (and dashes) stand to the right, sentences get room."""
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
