"""Grids of images: swapped reconstructions (Figures 6, 7), condition-invariant images (Figures 8, 9), translations."""

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


@styled()
def draw_image_grid(
    figure: Figure,
    images: Sequence[Sequence[Image | None]],
    *,
    row_labels: Sequence[str] = (),
    column_labels: Sequence[str] = (),
    header_row: bool = False,
    header_column: bool = False,
    corner: str = "",
    title: str = "",
) -> Axes:
    """Draws R×C images in rows and columns with labels at the left and above.

    The figure keeps its width and gets the height it needs; all cells have the shape of the first image.

    Args:
        figure: An empty figure.
        images: R rows of C images; None leaves a cell empty.
        row_labels: R texts, or none.
        column_labels: C texts, or none.
        header_row: Whether the first row is a header, set apart by a wider gap.
        header_column: Whether the first column is one.
        corner: Written in the first cell when it is empty; a formula may stand between `$`.
        title: Written above.

    Returns:
        The axes, in inches, with the images in the order of rows.

    Raises:
        ImageError: There is no image, or rows or labels differ in length.
    """
    first = _first_image(images, row_labels, column_labels)
    columns = len(images[0])
    width = float(figure.get_figwidth())
    left = _EDGE + _label_width(row_labels, width)
    top = _EDGE + (_TITLE if title else 0.0) + (_LABEL if column_labels else 0.0)
    wide_x = _HEADER_GAP if header_column else 0.0
    wide_y = _HEADER_GAP if header_row else 0.0
    cell = (width - left - _EDGE - wide_x - (columns - 1) * _GAP) / columns
    height = cell * first.shape[0] / first.shape[1]
    axes = inch_axes(figure, top + len(images) * (height + _GAP) - _GAP + wide_y + _EDGE)
    xs = [left + column * (cell + _GAP) + (wide_x if column else 0.0) for column in range(columns)]
    ys = [top + row * (height + _GAP) + (wide_y if row else 0.0) for row in range(len(images))]
    _write_title(axes, title)
    for x, label in zip(xs, column_labels, strict=False):
        _label_above(axes, label, Cell(x, top, cell, height))
    for y, label in zip(ys, row_labels, strict=False):
        _label_left(axes, label, Cell(left, y, cell, height))
    for y, row in zip(ys, images, strict=True):
        for x, image in zip(xs, row, strict=True):
            if image is not None:
                place_image(axes, image, Cell(x, y, cell, height))
    if corner and images[0][0] is None:
        centre = (xs[0] + cell / 2, ys[0] + height / 2)
        axes.text(*centre, corner, fontsize=_SIZE, ha="center", va="center", color=INK)
    return axes


def draw_swap_grid(
    figure: Figure,
    swapped: Sequence[Sequence[Image]],
    place_frames: Sequence[Image],
    condition_frames: Sequence[Image],
    *,
    place_labels: Sequence[str] = (),
    condition_labels: Sequence[str] = (),
    title: str = "",
) -> Axes:
    """Draws what is decoded from the place of one frame and the condition of another (Figures 6 and 7).

    Args:
        figure: An empty figure; see `draw_image_grid`.
        swapped: A×B images: in row a and column b the one decoded from {z_p of frame a, z_c of frame b}.
        place_frames: The A original frames that give z_p: the header column.
        condition_frames: The B original frames that give z_c: the header row.
        place_labels: A texts, or none.
        condition_labels: B texts, or none.
        title: Written above.

    Returns:
        The axes: the header row's images first, then row by row the header and its swapped images.

    Raises:
        ImageError: The numbers of images do not fit together.
    """
    if len(swapped) != len(place_frames) or any(len(row) != len(condition_frames) for row in swapped):
        raise ImageError(
            "cannot draw the swap grid; give a row for each place frame and a column for each condition frame"
        )
    rows: list[list[Image | None]] = [[None, *condition_frames]]
    rows.extend([frame, *row] for frame, row in zip(place_frames, swapped, strict=True))
    return draw_image_grid(
        figure,
        rows,
        row_labels=["", *place_labels] if place_labels else (),
        column_labels=["", *condition_labels] if condition_labels else (),
        header_row=True,
        header_column=True,
        corner="$z_p$ ↓   $z_c$ →",
        title=title,
    )


@styled()
def draw_constant_grid(
    figure: Figure,
    originals: Sequence[Image],
    invariant: Sequence[Image],
    *,
    labels: Sequence[str] = (),
    columns: int = 8,
    title: str = "",
) -> Axes:
    """Draws frames above what is decoded from their z_p and one constant z_c (Figures 8 and 9).

    The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        originals: N frames.
        invariant: N images decoded from {z_p of the frame, the constant z_c}.
        labels: N texts, written above the frames, or none.
        columns: Frames beside each other; more go on in further pairs of rows.
        title: Written above.

    Returns:
        The axes, in inches: for each line of frames the originals first, then their images.

    Raises:
        ImageError: There is no image, or the numbers differ.
    """
    N = len(originals)
    if N == 0 or len(invariant) != N or (labels and len(labels) != N):
        raise ImageError("cannot draw the constant grid; give frames, and one image (and one label, if any) for each")
    columns = max(1, min(columns, N))
    width = float(figure.get_figwidth())
    left = _EDGE + _label_width(_PAIR, width)
    cell = (width - left - _EDGE - (columns - 1) * _GAP) / columns
    height = cell * originals[0].shape[0] / originals[0].shape[1]
    above = _LABEL if labels else 0.0
    pair = above + 2 * height + _GAP
    lines = [range(start, min(start + columns, N)) for start in range(0, N, columns)]
    top = _EDGE + (_TITLE if title else 0.0)
    axes = inch_axes(figure, top + len(lines) * (pair + 2 * _HEADER_GAP) - 2 * _HEADER_GAP + _EDGE)
    _write_title(axes, title)
    for number, line in enumerate(lines):
        y = top + number * (pair + 2 * _HEADER_GAP) + above
        for row, images in enumerate((originals, invariant)):
            first = Cell(left, y + row * (height + _GAP), cell, height)
            _label_left(axes, _PAIR[row], first)
            for column, index in enumerate(line):
                here = first._replace(x=left + column * (cell + _GAP))
                place_image(axes, images[index], here)
                if labels and row == 0:
                    _label_above(axes, labels[index], here)
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
    name: str = ""


@styled()
def draw_translations(
    figure: Figure, translations: Sequence[Translation], *, conditions: Sequence[str], title: str = ""
) -> Axes:
    """Draws each frame beside its translations, with the true frames of the same conditions below them.

    The figure keeps its width and gets the height it needs.

    Args:
        figure: An empty figure.
        translations: In the order of rows, from the top.
        conditions: C names, written above the translations.
        title: Written above.

    Returns:
        The axes, in inches: for each frame itself, then its translations, then the true frames.

    Raises:
        ImageError: There is no frame, or one has not C translations and C true frames.
    """
    C = len(conditions)
    if not translations or not C or any(len(one.translated) != C or len(one.true) != C for one in translations):
        raise ImageError("cannot draw the translations; give frames, with an image and a true frame a condition")
    width = float(figure.get_figwidth())
    between = _HEADER_GAP + _label_width(_STRIP, width)
    cell = (width - 2 * _EDGE - between - (C - 1) * _GAP) / (C + 1)
    height = cell * translations[0].frame.shape[0] / translations[0].frame.shape[1]
    strip = _LABEL + 2 * height + _GAP
    top = _EDGE + (_TITLE if title else 0.0)
    axes = inch_axes(figure, top + len(translations) * (strip + _HEADER_GAP) - _HEADER_GAP + _EDGE)
    _write_title(axes, title)
    for number, one in enumerate(translations):
        here = Cell(_EDGE, top + number * (strip + _HEADER_GAP) + _LABEL, cell, height)
        place_image(axes, one.frame, here)
        _label_above(axes, one.name, here)
        for row, images in enumerate((one.translated, one.true)):
            first = Cell(_EDGE + cell + between, here.y + row * (height + _GAP), cell, height)
            _label_left(axes, _STRIP[row], first, width=between)
            for column, image in enumerate(images):
                there = first._replace(x=first.x + column * (cell + _GAP))
                place_image(axes, image, there)
                if row == 0:
                    _label_above(axes, conditions[column], there)
    return axes


_PAIR = ("original", "constant z_c")
_STRIP = ("decoded", "true")


def _label_width(labels: Sequence[str], width: float) -> float:
    """The room that labels at the left need, in inches: at most a fifth of the figure."""
    longest = max((len(label) for label in labels), default=0)
    return min(longest * 0.6 * _SIZE / 72.0 + 0.1, width / 5) if longest else 0.0


def _first_image(
    images: Sequence[Sequence[Image | None]], row_labels: Sequence[str], column_labels: Sequence[str]
) -> Image:
    """Finds the image that gives all cells their shape, once rows and labels are known to fit."""
    columns = len(images[0]) if images else 0
    first = next((image for image in itertools.chain.from_iterable(images) if image is not None), None)
    if first is None or any(len(row) != columns for row in images):
        raise ImageError("cannot draw a grid of images; give at least one image, and rows of equal length")
    for labels, wanted in ((row_labels, len(images)), (column_labels, columns)):
        if labels and len(labels) != wanted:
            raise ImageError(f"cannot label {wanted} rows or columns with {len(labels)} texts; give one text each")
    return first


def _write_title(axes: Axes, title: str) -> None:
    if title:
        place_text(axes, title, _EDGE, _EDGE, width=axes.get_xlim()[1] - 2 * _EDGE, size=10.0, va="top")


def _label_above(axes: Axes, label: str, cell: Cell) -> None:
    look = {"ha": "center", "va": "bottom", "color": MUTED}
    place_text(axes, label, cell.x + cell.width / 2, cell.y - 0.04, width=cell.width, size=_SIZE, **look)


def _label_left(axes: Axes, label: str, cell: Cell, *, width: float | None = None) -> None:
    """Writes beside a cell, in all the room at its left or in `width` inches of it."""
    look = {"ha": "right", "va": "center", "color": MUTED}
    room = cell.x - _EDGE if width is None else width
    place_text(axes, label, cell.x - 0.08, cell.y + cell.height / 2, width=room, size=_SIZE, **look)
