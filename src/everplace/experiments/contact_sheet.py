"""A contact sheet: the same places in every traverse, to see whether a route is what it claims to be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from everplace.errors import ImageError
from everplace.images.decoding import ImageSpec, decode_image, resize_image
from everplace.plots.canvas import Image, new_figure
from everplace.plots.image_grids import draw_image_grid
from everplace.route.route import Route
from everplace.route.selection import spread

__all__ = ["contact_sheet"]

_LONGEST_SIDE = 480


def contact_sheet(route: Route, places: Sequence[str] = (), *, count: int = 8) -> Figure:
    """Draws one row a place and one column a traverse.

    Where the traverses are not aligned, a row holds what each shows after the same part of its frames, and the title
    says so. A frame that cannot be decoded leaves its cell empty.

    Args:
        route: The traverses.
        places: Stems to choose from, evenly spread; none: all that the traverses share.
        count: How many rows, at most.

    Returns:
        The figure.

    Raises:
        ImageError: No frame can be decoded.
    """
    chosen = list(places or route.shared_stems())
    names = [t.name if t.name == t.condition else f"{t.name} ({t.condition})" for t in route.traverses]
    if chosen:
        labels = [chosen[position] for position in spread(len(chosen), count)]
        traverses = route.at(labels).traverses
        title = f"{route.name}: {len(labels)} of {len(chosen)} places"
    else:
        count = min(count, *(len(traverse) for traverse in route.traverses))
        labels = [f"{100 * row / count:.0f} %" for row in range(count)]
        traverses = tuple(t.take([row * len(t) // count for row in range(count)]) for t in route.traverses)
        title = f"{route.name}: not aligned, so the frames of a row are not the same place"
    rows = [[_picture(traverse.paths[row]) for traverse in traverses] for row in range(len(labels))]
    figure = new_figure(min(12.0, 1.0 + 3.0 * len(traverses)))
    draw_image_grid(figure, rows, row_labels=labels, column_labels=names, title=title)
    return figure


def _picture(path: Path) -> Image | None:
    """Decodes a frame and shrinks it to what a sheet can show."""
    try:
        image = decode_image(path, ImageSpec())
    except ImageError:
        return None
    shrink = min(1.0, _LONGEST_SIDE / max(image.shape))
    return resize_image(image, (max(1, round(image.shape[0] * shrink)), max(1, round(image.shape[1] * shrink))))
