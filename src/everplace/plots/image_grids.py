"""Grids of images: swapped reconstructions (Figures 6, 7), condition-invariant images (Figures 8, 9), translations.

Every figure keeps its width and gets the height it needs; all cells of a grid have the shape of its first image.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from everplace.errors import ImageError
from everplace.plots.canvas import Cell, Image, inch_axes, place_image, place_text
from everplace.plots.style import INK, MUTED, styled

__all__ = ["Translation", "draw_constant_grid", "draw_image_grid", "draw_swap_grid", "draw_translations"]

_EDGE = 0.1
_GAP = 0.04
_TITLE = 0.3
_LABEL = 0.18
_HEADER_GAP = 0.1
_SIZE = 8.0
_PAIR = ("original", "constant z_c")
_STRIP = ("decoded", "true")


@styled()
def draw_image_grid(
    figure: Figure,
    images: Sequence[Sequence[Image | None]],
    *,
    row_labels: Sequence[str],
    column_labels: Sequence[str],
    title: str,
) -> Axes:
    """Draws R×C images in rows and columns with labels at the left and above.

    Args:
        figure: An empty figure.
        images: R rows of C images; None leaves a cell empty.
        row_labels: R texts.
        column_labels: C texts.
        title: Written above.

    Returns:
        The axes, in inches, with the images in the order of rows.

    Raises:
        ImageError: There is no image.
    """
    shape = next((image.shape for image in itertools.chain.from_iterable(images) if image is not None), None)
    if shape is None:
        raise ImageError("cannot draw a grid of images; give at least one image")
    width = float(figure.get_figwidth())
    left, top = _EDGE + _label_width(row_labels, width), _EDGE + _TITLE + _LABEL
    columns = len(column_labels)
    cell = (width - left - _EDGE - (columns - 1) * _GAP) / columns
    height = cell * shape[0] / shape[1]
    axes = inch_axes(figure, top + len(images) * (height + _GAP) - _GAP + _EDGE)
    _write_title(axes, title)
    _draw_block(axes, images, Cell(left, top, cell, height), row_labels, column_labels)
    return axes


@styled()
def draw_swap_grid(
    figure: Figure,
    swapped: Sequence[Sequence[Image]],
    place_frames: Sequence[Image],
    condition_frames: Sequence[Image],
    *,
    place_labels: Sequence[str],
    condition_labels: Sequence[str],
    title: str,
) -> Axes:
    """Draws what is decoded from the place of one frame and the condition of another (Figures 6 and 7).

    Args:
        figure: An empty figure.
        swapped: A×B images: in row a and column b the one decoded from {z_p of frame a, z_c of frame b}.
        place_frames: The A original frames that give z_p: a column of their own at the left.
        condition_frames: The B original frames that give z_c: a row of their own above.
        place_labels: A texts.
        condition_labels: B texts.
        title: Written above.

    Returns:
        The axes, in inches: the frames that give z_c, those that give z_p, then the swapped images row by row.
    """
    A, B = len(place_frames), len(condition_frames)
    width = float(figure.get_figwidth())
    left, top = _EDGE + _label_width(place_labels, width), _EDGE + _TITLE + _LABEL
    cell = (width - left - _EDGE - _HEADER_GAP - B * _GAP) / (B + 1)
    height = cell * condition_frames[0].shape[0] / condition_frames[0].shape[1]
    axes = inch_axes(figure, top + (A + 1) * (height + _GAP) - _GAP + _HEADER_GAP + _EDGE)
    _write_title(axes, title)
    corner = Cell(left, top, cell, height)
    inner = corner._replace(x=left + cell + _GAP + _HEADER_GAP, y=top + height + _GAP + _HEADER_GAP)
    _draw_block(axes, [condition_frames], inner._replace(y=top), column_labels=condition_labels)
    _draw_block(axes, [[frame] for frame in place_frames], inner._replace(x=left), row_labels=place_labels)
    _draw_block(axes, swapped, inner)
    centre = (corner.x + cell / 2, corner.y + height / 2)
    axes.text(*centre, "$z_p$ ↓   $z_c$ →", fontsize=_SIZE, ha="center", va="center", color=INK)
    return axes


@styled()
def draw_constant_grid(
    figure: Figure,
    originals: Sequence[Image],
    invariant: Sequence[Image],
    *,
    labels: Sequence[str],
    columns: int,
    title: str,
) -> Axes:
    """Draws frames above what is decoded from their z_p and one constant z_c (Figures 8 and 9).

    Args:
        figure: An empty figure.
        originals: N frames.
        invariant: N images decoded from {z_p of the frame, the constant z_c}.
        labels: N texts, written above the frames.
        columns: Frames beside each other; more go on in further pairs of rows.
        title: Written above.

    Returns:
        The axes, in inches: for each line of frames the originals first, then their images.
    """
    width = float(figure.get_figwidth())
    left, top = _EDGE + _label_width(_PAIR, width), _EDGE + _TITLE
    cell = (width - left - _EDGE - (columns - 1) * _GAP) / columns
    height = cell * originals[0].shape[0] / originals[0].shape[1]
    pair = _LABEL + 2 * height + _GAP + 2 * _HEADER_GAP
    lines = [slice(start, start + columns) for start in range(0, len(originals), columns)]
    axes = inch_axes(figure, top + len(lines) * pair - 2 * _HEADER_GAP + _EDGE)
    _write_title(axes, title)
    for number, line in enumerate(lines):
        first = Cell(left, top + number * pair + _LABEL, cell, height)
        _draw_block(axes, [originals[line], invariant[line]], first, _PAIR, labels[line])
    return axes


@dataclass(frozen=True, slots=True)
class Translation:
    """One frame shown in several conditions.

    Attributes:
        frame: The frame itself.
        translated: C images decoded from {z_p of the frame, z_c of each condition}.
        true: The C frames that show its place in these conditions.
        name: Written above the frame.
    """

    frame: Image
    translated: Sequence[Image]
    true: Sequence[Image]
    name: str


@styled()
def draw_translations(
    figure: Figure, translations: Sequence[Translation], *, conditions: Sequence[str], title: str
) -> Axes:
    """Draws each frame beside its translations, with the true frames of the same conditions below them.

    Args:
        figure: An empty figure.
        translations: In the order of rows, from the top; at least one.
        conditions: C names, written above the translations.
        title: Written above.

    Returns:
        The axes, in inches: for each frame itself, then its translations, then the true frames.
    """
    C = len(conditions)
    width = float(figure.get_figwidth())
    between = _HEADER_GAP + _label_width(_STRIP, width)
    cell = (width - 2 * _EDGE - between - (C - 1) * _GAP) / (C + 1)
    height = cell * translations[0].frame.shape[0] / translations[0].frame.shape[1]
    strip = _LABEL + 2 * height + _GAP + _HEADER_GAP
    top = _EDGE + _TITLE
    axes = inch_axes(figure, top + len(translations) * strip - _HEADER_GAP + _EDGE)
    _write_title(axes, title)
    for number, one in enumerate(translations):
        here = Cell(_EDGE, top + number * strip + _LABEL, cell, height)
        _draw_block(axes, [[one.frame]], here, column_labels=[one.name])
        beside = here._replace(x=_EDGE + cell + between)
        _draw_block(axes, [one.translated, one.true], beside, _STRIP, conditions, room=between)
    return axes


def _draw_block(
    axes: Axes,
    images: Sequence[Sequence[Image | None]],
    first: Cell,
    row_labels: Sequence[str] = (),
    column_labels: Sequence[str] = (),
    *,
    room: float | None = None,
) -> None:
    """Draws rows of images from a first cell on, with labels above them and in `room` inches at their left (all)."""

    def cell(row: int, column: int) -> Cell:
        return first._replace(x=first.x + column * (first.width + _GAP), y=first.y + row * (first.height + _GAP))

    for column, label in enumerate(column_labels):
        _label_above(axes, label, cell(0, column))
    for row, label in enumerate(row_labels):
        _label_left(axes, label, cell(row, 0), width=room)
    for row, line in enumerate(images):
        for column, image in enumerate(line):
            if image is not None:
                place_image(axes, image, cell(row, column))


def _label_width(labels: Sequence[str], width: float) -> float:
    """The room that labels at the left need, in inches: at most a fifth of the figure."""
    return min(max(map(len, labels)) * 0.6 * _SIZE / 72.0 + 0.1, width / 5)


def _write_title(axes: Axes, title: str) -> None:
    place_text(axes, title, _EDGE, _EDGE, width=axes.get_xlim()[1] - 2 * _EDGE, size=10.0, va="top")


def _label_above(axes: Axes, label: str, cell: Cell) -> None:
    look = {"ha": "center", "va": "bottom", "color": MUTED}
    place_text(axes, label, cell.x + cell.width / 2, cell.y - 0.04, width=cell.width, size=_SIZE, **look)


def _label_left(axes: Axes, label: str, cell: Cell, *, width: float | None = None) -> None:
    """Writes beside a cell, in all the room at its left or in `width` inches of it."""
    look = {"ha": "right", "va": "center", "color": MUTED}
    room = cell.x - _EDGE if width is None else width
    place_text(axes, label, cell.x - 0.08, cell.y + cell.height / 2, width=room, size=_SIZE, **look)
