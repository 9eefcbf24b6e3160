"""The one place for colours, line styles and text treatment of every picture.

The colours are those of Okabe and Ito (2008, "Color Universal Design"), which stay apart for colour-blind
readers. Their yellow and black are left out: yellow lines vanish on white and black ones in a dark report.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text

__all__ = [
    "CHOSEN",
    "COLOURS",
    "INK",
    "MUTED",
    "RIGHT",
    "RIGHT_TEXT",
    "SEQUENTIAL",
    "WRONG",
    "WRONG_TEXT",
    "LineLook",
    "line_looks",
    "mark_legend",
    "polish",
    "set_legend",
    "shortened",
    "styled",
    "write_plainly",
]

COLOURS: tuple[str, ...] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#767676")
"""Okabe-Ito blue, vermillion, bluish green, reddish purple, orange, sky blue; then a grey."""

INK = "#222222"
MUTED = "#6B6B6B"
RIGHT = "#0072B2"
WRONG = "#D55E00"
CHOSEN = "#009E73"
RIGHT_TEXT = "✓ right"
WRONG_TEXT = "✗ wrong"
SEQUENTIAL = "viridis"
"""A colour map whose lightness rises steadily, so it survives grey printing and colour blindness."""

_DASHES: tuple[tuple[str, str], ...] = (("-", "solid"), ("--", "dash"), ("-.", "dashdot"), (":", "dot"))

_SETTINGS: dict[str, Any] = {
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.labelsize": 9.0,
    "axes.titlesize": 10.0,
    "figure.facecolor": "white",
    "font.family": ["DejaVu Sans"],
    "font.size": 9.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "svg.hashsalt": "everplace",
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelsize": 8.0,
    "ytick.color": MUTED,
    "ytick.labelsize": 8.0,
}

# rcParams belong to the whole process: two threads that enter and leave the style in turn would restore
# each other's settings and leave ours behind.
_one_at_a_time = threading.RLock()


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Draws in the house style inside the block or the decorated function, and restores everything after.

    It starts from matplotlib's own defaults, so a reader's `matplotlibrc` (LaTeX text, another colour map)
    changes no report. Threads take turns.
    """
    # The backend is left alone: switching it is for windows, which nothing here opens.
    settings: dict[Any, Any] = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")}
    settings.update(_SETTINGS)
    with _one_at_a_time, mpl.rc_context(settings):
        yield


class LineLook(NamedTuple):
    """How one curve looks: its colour, and its dashes in matplotlib's and in plotly's words."""

    colour: str
    dashes: str
    plotly_dashes: str


def line_looks(labels: Iterable[str]) -> dict[str, LineLook]:
    """Gives each label a look; the same labels in the same order look the same in every picture.

    Args:
        labels: Names of curves, in the order of the legend; a repeated name keeps its first look.

    Returns:
        One look a label. The first 28 labels are all different; after that looks repeat.
    """
    looks: dict[str, LineLook] = {}
    for label in labels:
        if label not in looks:
            dash, colour = divmod(len(looks), len(COLOURS))
            looks[label] = LineLook(COLOURS[colour], *_DASHES[dash % len(_DASHES)])
    return looks


def write_plainly(*texts: Text) -> None:
    """Makes texts show their characters as they are: a `$` in a file name is no formula."""
    for text in texts:
        text.set_parse_math(False)


def shortened(text: str, width: float, size: float) -> str:
    """Cuts a text in its middle so that it fits, because both ends of a frame's name tell something.

    Args:
        text: One line.
        width: The room it has, in inches.
        size: Font size in points.

    Returns:
        The text, or its two ends around an ellipsis.
    """
    room = max(2, int(width * 72.0 / (0.6 * size)))  # 0.6 em: a mean character of DejaVu Sans
    if len(text) <= room:
        return text
    head = room // 2
    tail = room - head - 1
    return f"{text[:head]}…{text[len(text) - tail :]}"


def polish(axes: Axes) -> None:
    """Gives an axes for curves its light grid and removes the two spines that carry no scale."""
    axes.grid(visible=True, color="#E3E3E3", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(labelsize=8.0, color=MUTED, labelcolor=MUTED)


def set_legend(owner: Axes | Figure, handles: Sequence[Artist], labels: Sequence[str], **options: Any) -> Legend:
    """Adds a legend whose labels may be any text.

    matplotlib leaves out labels that start with an underscore and reads `$` as a formula; a run directory
    may be called either way.

    Args:
        owner: The axes or figure that gets the legend.
        handles: The artists to explain.
        labels: One text a handle.
        **options: Passed on to `legend`.

    Returns:
        The legend.
    """
    legend = owner.legend(handles, [str(number) for number in range(len(labels))], **options)
    for text, label in zip(legend.get_texts(), labels, strict=True):
        write_plainly(text)
        text.set_text(label)
    return legend


def mark_legend(axes: Axes, marks: Mapping[str, Artist], *, below: float = 40.0) -> Legend:
    """Explains marks that lie on a picture in the colours of `SEQUENTIAL`, in a dark box below it.

    The box is dark because such marks are made to be seen on the dark end of the colour map.

    Args:
        axes: Where the marks are.
        marks: At least one: the text and the artist of each.
        below: Points from the lower edge of the axes to the box, room for the labels of the axis.

    Returns:
        The legend.
    """
    return set_legend(
        axes, list(marks.values()), list(marks), ncols=len(marks), frameon=True, facecolor="#5A5A5A", edgecolor="none",
        labelcolor="white", loc="upper center", bbox_to_anchor=(0.5, 0.0),
        borderaxespad=below / _SETTINGS["legend.fontsize"],
    )  # fmt: skip
