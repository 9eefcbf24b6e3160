"""Figures without windows: making them, placing images on them by the inch, and turning them into files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray
from PIL import Image as PillowImage

from everplace.errors import ConfigError
from everplace.files import readable, whole_file
from everplace.plots.style import shortened, styled, write_plainly

__all__ = [
    "Cell",
    "Image",
    "inch_axes",
    "new_axes",
    "new_figure",
    "palette_png_bytes",
    "place_image",
    "place_text",
    "png_bytes",
    "save_figure",
    "svg_bytes",
    "webp_bytes",
]

Image: TypeAlias = NDArray[np.uint8]
"""H×W×1 or H×W×3 (RGB)."""


class Cell(NamedTuple):
    """A rectangle on an axes from `inch_axes`: its left upper corner and its size, in inches."""

    x: float
    y: float
    width: float
    height: float


_DPI = 192.0
"""Dots an inch: two pixels for each of a web page's."""

# Nothing that changes from run to run is stored, so the same picture is the same file.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@styled()
def new_figure(width: float = 8.0, height: float = 4.5) -> Figure:
    """Makes an empty figure that no window and no `pyplot` knows of.

    Args:
        width: In inches.
        height: In inches; the functions that place images set it to what they need.
    """
    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1))
    FigureCanvasAgg(figure)
    return figure


@styled()
def new_axes(width: float = 6.0, height: float = 4.5) -> tuple[Figure, Axes]:
    """Makes a figure with one axes on it (sizes in inches)."""
    figure = new_figure(width, height)
    return figure, figure.add_subplot()


def inch_axes(figure: Figure, height: float) -> Axes:
    """Covers the whole figure with one invisible axes whose units are inches, y downwards from the top.

    Args:
        figure: Keeps its width; gets the height.
        height: In inches.
    """
    figure.set_layout_engine("none")
    width = float(figure.get_figwidth())
    figure.set_size_inches(width, height)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, width)
    axes.set_ylim(height, 0.0)
    return axes


def place_image(axes: Axes, image: Image, cell: Cell) -> AxesImage:
    """Draws an image into a cell as large as it fits without distortion, centred.

    Args:
        axes: From `inch_axes`.
        image: What to draw.
        cell: Where it goes.
    """
    rows, columns = image.shape[:2]
    pixels = np.broadcast_to(image, (rows, columns, 3))
    scale = min(cell.width / columns, cell.height / rows)
    left = cell.x + (cell.width - columns * scale) / 2
    top = cell.y + (cell.height - rows * scale) / 2
    return axes.imshow(pixels, extent=(left, left + columns * scale, top + rows * scale, top), aspect="auto")


def place_text(axes: Axes, text: str, x: float, y: float, *, width: float, size: float = 7.5, **options: Any) -> None:
    """Writes one line at a point, shortened to the width it has (inches); `options` go to `Axes.text`."""
    write_plainly(axes.text(x, y, shortened(text, width, size), fontsize=size, **options))


@styled()
def png_bytes(figure: Figure, dpi: float = _DPI) -> bytes:
    """Renders a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata=_METADATA["png"])
    return buffer.getvalue()


def palette_png_bytes(figure: Figure, dpi: float = _DPI) -> bytes:
    """Renders a figure as PNG of 256 colours, in a third of the bytes; no eye tells it from the exact one."""
    buffer = io.BytesIO()
    with PillowImage.open(io.BytesIO(png_bytes(figure, dpi))) as picture:
        colours = picture.convert("RGB").quantize(
            256, method=PillowImage.Quantize.MAXCOVERAGE, dither=PillowImage.Dither.NONE
        )
        colours.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


@styled()
def webp_bytes(figure: Figure, dpi: float = _DPI) -> bytes:
    """Renders a figure of photographs as WebP, which takes a fraction of the bytes of PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="webp", dpi=dpi, pil_kwargs={"quality": 80})
    return buffer.getvalue()


@styled()
def svg_bytes(figure: Figure) -> bytes:
    """Renders a figure as SVG, with text as outlines so that it needs no font."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata=_METADATA["svg"])
    return buffer.getvalue()


@styled()
def save_figure(figure: Figure, path: Path) -> None:
    """Writes a figure whole, in the format that the file's suffix names.

    Args:
        figure: What to write.
        path: Ends in `.png`, `.svg` or `.pdf`.

    Raises:
        ConfigError: The suffix is another one.
        StorageError: The file cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise ConfigError(f"cannot write a picture to {readable(path)}; choose a name that ends in .png, .svg or .pdf")
    with whole_file(path) as temporary:
        figure.savefig(temporary, format=kind, dpi=_DPI, metadata=_METADATA[kind])
