"""`ROUTE/route.toml`: what a route's directories cannot say by themselves.

All of it is optional:

    aligned = false                 # equal stems in two traverses are not the same place; default: they are
    tolerance = 1                   # frames: up to here two places count as the same
    radius = 25.0                   # or metres, where there are poses
    truth = "truth.csv"             # or a list of the pairs of frames that show the same place
    ignore = ["thumbnails"]         # sub-directories that are no traverses
    protocol = "olid"               # the published protocol that chose the frames, to be named in results

    [traverses.jan14]
    condition = "winter"            # default: the traverse's name
    pattern = "left_*.png"          # which files are frames; default: all with an image's ending
    poses = "poses/jan14.csv"       # columns stem,x,y,heading; default: poses.csv in the traverse
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from everplace.errors import ConfigError
from everplace.files import readable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["ROUTE_TOML", "RouteToml", "TraverseToml", "read_route_toml"]

ROUTE_TOML = "route.toml"

_Text = Annotated[str, Field(min_length=1)]


class TraverseToml(BaseModel):
    """What route.toml says about one traverse.

    Attributes:
        condition: The condition; None: the traverse's name.
        pattern: A shell pattern that file names must match; None: every file with an image's ending.
        poses: A CSV file, from the route's directory; None: `poses.csv` in the traverse, if it is there.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    condition: _Text | None = None
    pattern: Annotated[str, Field(min_length=1, pattern=r"^[^/]+$")] | None = None
    poses: _Text | None = None


class RouteToml(BaseModel):
    """What route.toml says.

    Attributes:
        aligned: Whether equal stems in two traverses are the same place.
        tolerance: Frames by which a match may be off; None: not said.
        radius: Metres by which a match may be off; None: not said. Not beside `tolerance`.
        truth: A CSV file of pairs, from the route's directory (see `data.truth.TruthTable`); None: there is
            none. Not beside the other two.
        ignore: Names of sub-directories that are no traverses.
        protocol: The published protocol that chose the frames; None: none.
        traverses: What is said about single traverses, by name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    aligned: bool = True
    tolerance: Annotated[int, Field(ge=0)] | None = None
    radius: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    truth: _Text | None = None
    ignore: tuple[_Text, ...] = Field(default=(), strict=False)
    protocol: _Text | None = None
    traverses: dict[str, TraverseToml] = {}

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
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return RouteToml()
    except OSError as error:
        raise ConfigError(f"cannot read {readable(path)}: {error.strerror or error}; check its permissions") from error
    except RecursionError as error:
        raise ConfigError(f"{readable(path)} nests its values too deeply; correct it") from error
    except ValueError as error:  # not UTF-8, not TOML, or a number of thousands of digits
        raise ConfigError(f"{readable(path)} is not valid TOML ({error}); correct it") from error
    try:
        return RouteToml.model_validate(content)
    except ValidationError as error:
        raise ConfigError(_first_problem(path, error)) from error


def _first_problem(path: Path, error: ValidationError) -> str:
    """Says in one sentence which key is wrong."""
    problem = error.errors(include_url=False)[0]
    location = problem["loc"]
    key = ".".join(str(part) for part in location)
    if problem["type"] == "extra_forbidden":
        model = TraverseToml if location[0] == "traverses" else RouteToml
        known = ", ".join(sorted(model.model_fields))
        return f"unknown key {key!r} in {readable(path)}; known here: {known}"
    what = problem["msg"].removeprefix("Value error, ")
    return f"wrong value of {key!r} in {readable(path)}: {what}" if key else f"{readable(path)}: {what}"
