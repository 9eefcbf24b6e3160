"""Where the frames of a drive were found on a map: those that are sure, and those that are not."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from everplace.plots.style import MUTED, RIGHT, polish, set_legend, styled, write_plainly

__all__ = ["draw_matched_frames"]


@styled()
def draw_matched_frames(
    axes: Axes, places: NDArray[np.int64], sure: NDArray[np.bool_], *, drive: str, map_drive: str, title: str
) -> None:
    """Draws the best place of every frame: a drive along the map is a line, one of elsewhere a cloud.

    Args:
        axes: Where to draw.
        places: (M,) of the drive's frames, in the order of travel.
        sure: (M,) whether the match is believed.
        drive: Name of the drive, the horizontal axis.
        map_drive: Name of the map, the vertical axis.
        title: Written above.
    """
    frames = np.arange(len(places))
    kinds: tuple[tuple[str, NDArray[np.bool_], dict[str, Any]], ...] = (
        ("refused", ~sure, {"color": MUTED, "marker": "x", "s": 8, "linewidths": 0.6}),
        ("sure", sure, {"color": RIGHT, "marker": "o", "s": 8, "linewidths": 0}),
    )
    marks = {f"{what}: {chosen.sum():,}": axes.scatter(frames[chosen], places[chosen], **look)
             for what, chosen, look in kinds}  # fmt: skip
    polish(axes)
    write_plainly(
        axes.set_xlabel(f"frame of {drive}"),
        axes.set_ylabel(f"place of {map_drive}"),
        axes.set_title(title, loc="left"),
    )
    set_legend(axes, list(marks.values()), list(marks), loc="upper left")
