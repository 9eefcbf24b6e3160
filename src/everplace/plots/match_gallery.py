"""A gallery of matches: what was asked, what was proposed, and, where it is known, what would have been right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from everplace.plots.canvas import Cell, Image, inch_axes, place_image, place_text
from everplace.plots.style import INK, MUTED, RIGHT, RIGHT_TEXT, WRONG, WRONG_TEXT, styled

__all__ = ["Match", "draw_matches"]

_EDGE = 0.12
_GAP = 0.08
_BETWEEN = 0.3
_TITLE = 0.3
_NOTE = 0.2
_HEADING = 0.22
_CAPTION = 0.38
_HEADINGS = ("query", "proposed", "true")
_VERDICTS: dict[bool | None, tuple[str, str, Any]] = {
    True: (RIGHT, RIGHT_TEXT, "-"),
    False: (WRONG, WRONG_TEXT, (0, (4, 2))),
    None: (INK, "", "-"),
}
"""Colour, word and line of a proposal, by whether it is right."""


@dataclass(frozen=True, slots=True)
class Match:
    """One query with its best database frame.

    Attributes:
        query: The query frame's image.
        proposed: The image of the best database frame.
        true: The image of the true database frame; None when the query's place is not in the database, or unknown.
        score: The score of `proposed`.
        right: Whether `proposed` shows the query's place; None: nobody knows.
        query_name: Written below the query; the other names likewise.
        proposed_name: Name of the best database frame.
        true_name: Name of the true database frame.
    """

    query: Image
    proposed: Image
    true: Image | None
    score: float
    right: bool | None
    query_name: str
    proposed_name: str
    true_name: str


@styled()
def draw_matches(figure: Figure, matches: Sequence[Match], *, title: str, note: str) -> Axes:
    """Draws query | proposed | true for every match, with its score and whether it is right.

    Right and wrong differ by colour, by the word and its sign, and by the line around the proposal (solid or
    dashed). Where nobody knows what is right, query | proposed and the score are all. More than three matches stand in
    two columns. The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        matches: At least one, in the order of rows, left to right; of all it is known what is right, or of none.
        title: Written above.
        note: Written below the title, smaller: which matches count as right, and what their numbers are.

    Returns:
        The axes, in inches, with three images a match (two where there is no true frame).
    """
    columns = 1 if len(matches) <= 3 else 2
    headings = _HEADINGS if any(match.right is not None for match in matches) else _HEADINGS[:2]
    width = float(figure.get_figwidth())
    group = (width - 2 * _EDGE - (columns - 1) * _BETWEEN) / columns
    cell = (group - 2 * _GAP) / len(headings)
    tallest = max(match.query.shape[0] / match.query.shape[1] for match in matches)
    height = cell * min(tallest, 1.5)  # a very tall image is drawn narrower rather than over the whole page
    under_title = _EDGE + _TITLE
    top = under_title + _NOTE
    rows = math.ceil(len(matches) / columns)
    axes = inch_axes(figure, top + _HEADING + rows * (height + _CAPTION) + _EDGE)
    place_text(axes, title, _EDGE, _EDGE, width=width, size=10.0, va="top")
    place_text(axes, note, _EDGE, under_title - 0.06, width=width, size=8.0, va="top", color=MUTED)
    for column in range(columns):
        for part, heading in enumerate(headings):
            x = _EDGE + column * (group + _BETWEEN) + part * (cell + _GAP) + cell / 2
            place_text(axes, heading, x, top, width=cell, size=8.5, ha="center", va="top", color=MUTED)
    for place, match in enumerate(matches):
        row, column = divmod(place, columns)
        x = _EDGE + column * (group + _BETWEEN)
        _draw_match(axes, match, Cell(x, top + _HEADING + row * (height + _CAPTION), cell, height))
    return axes


def _draw_match(axes: Axes, match: Match, first: Cell) -> None:
    """Draws one match: the query in the first cell, the two others to its right."""
    below = first.y + first.height + 0.04
    parts = [(match.query, match.query_name), (match.proposed, match.proposed_name), (match.true, match.true_name)]
    colour, word, line = _VERDICTS[match.right]
    if match.right is None:
        parts.pop()
    for part, (image, name) in enumerate(parts):
        cell = first._replace(x=first.x + part * (first.width + _GAP))
        centre = cell.x + cell.width / 2
        if image is None:
            look: dict[str, Any] = {"ha": "center", "va": "center", "color": MUTED}
            place_text(axes, "not in the database", centre, cell.y + cell.height / 2, width=cell.width, **look)
            continue
        drawn = place_image(axes, image, cell)
        place_text(axes, name, centre, below, width=cell.width, size=7.0, ha="center", va="top", color=MUTED)
        if part == 1:
            x0, x1, y1, y0 = drawn.get_extent()
            axes.add_patch(
                Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, edgecolor=colour, linestyle=line, linewidth=2.2)
            )
            verdict = f"{word}  {match.score:.3f}".strip()
            place_text(
                axes, verdict, centre, below + 0.13, width=cell.width, size=8.0,
                ha="center", va="top", color=colour, fontweight="bold",
            )  # fmt: skip
