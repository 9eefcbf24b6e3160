"""`ROUTE/route.toml`: what a route's directories cannot say by themselves.

All of it is optional:

    aligned = false                 # equal stems in two traverses are not the same place; default: they are
    tolerance = 1                   # frames: up to here two places count as the same
    radius = 25.0                   # or metres, where there are poses
    truth = "truth.csv"             # or a list of the pairs of frames that show the same place
    truth_from = "GPS within 10 m"  # where the knowledge of which frames show the same place comes from
    aligned_by = "hog"              # the method on whose descriptors the drives were aligned, if it was on images
    ignore = ["thumbnails"]         # sub-directories that are no traverses
    protocol = "olid"               # the published protocol that chose the frames, to be named in results

    [traverses.jan14]
    condition = "winter"            # default: the traverse's name
    pattern = "left_*.png"          # which files are frames; default: all with an image's ending
    poses = "poses/jan14.csv"       # columns stem,x,y,heading; default: poses.csv in the traverse
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from everplace.settings import Settings, read_settings

__all__ = ["ROUTE_TOML", "RouteToml", "TraverseToml", "read_route_toml"]

ROUTE_TOML = "route.toml"

_Text = Annotated[str, Field(min_length=1)]


class TraverseToml(Settings, strict=True):
    """What route.toml says about one traverse."""

    condition: _Text | None = None
    """The condition; None: the traverse's name."""
    pattern: Annotated[str, Field(min_length=1, pattern=r"^[^/]+$")] | None = None
    """A shell pattern that file names must match; None: every file with an image's ending."""
    poses: _Text | None = None
    """A CSV file, from the route's directory; None: `poses.csv` in the traverse, if it is there."""


class RouteToml(Settings, strict=True):
    """What route.toml says."""

    aligned: bool = True
    """Whether equal stems in two traverses are the same place."""
    tolerance: Annotated[int, Field(ge=0)] | None = None
    """Frames by which a match may be off; None: not said."""
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Metres by which a match may be off; None: not said. Not beside `tolerance`."""
    truth: _Text | None = None
    """A CSV file of pairs, from the route's directory (see `route.truth.TruthTable`); None: there is none. Not beside
    the other two."""
    truth_from: _Text | None = None
    """Where the knowledge of which frames show the same place comes from, for whoever reads a score; None: not said."""
    aligned_by: _Text | None = None
    """The method on whose descriptors the drives were aligned; None: they were not aligned by their images."""
    ignore: tuple[_Text, ...] = Field(default=(), strict=False)
    """Names of sub-directories that are no traverses."""
    protocol: _Text | None = None
    """The published protocol that chose the frames; None: none."""
    traverses: dict[str, TraverseToml] = Field(default={})
    """What is said about single traverses, by name."""

    @model_validator(mode="after")
    def _one_truth(self) -> RouteToml:
        said = [name for name in ("tolerance", "radius", "truth") if getattr(self, name) is not None]
        if len(said) > 1:
            raise ValueError(f"{' and '.join(said)} exclude each other, keep one")
        return self


def read_route_toml(route: Path) -> RouteToml:
    """Reads a route's `route.toml`, or gives the defaults where there is none.

    Raises:
        ConfigError: The file cannot be read, is no TOML, or holds an unknown key or a value that cannot be;
            the message names the file and the key.
    """
    path = route / ROUTE_TOML
    return read_settings(path, RouteToml) if os.path.lexists(path) else RouteToml()
