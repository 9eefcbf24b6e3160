"""Options that several commands share, so that they mean and read the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from everplace.choices import Engine, SequenceMethod, Standardisation
from everplace.errors import ConfigError

__all__ = [
    "AnySize",
    "Conditions",
    "Database",
    "DropDark",
    "DropStationary",
    "Epochs",
    "Frames",
    "Grey",
    "ImageSize",
    "Json",
    "Method",
    "Minutes",
    "OutDirectory",
    "OutFile",
    "Query",
    "QueryFrames",
    "Radius",
    "RouteArgument",
    "Seed",
    "Sequence",
    "SequenceSearch",
    "SourceOptions",
    "Standardise",
    "Tolerance",
    "given_pairs",
    "only_given",
    "split_names",
]  # fmt: skip

RouteArgument = Annotated[Path, typer.Argument(metavar="ROUTE", help="Directory with one sub-directory a traverse.")]
OutDirectory = Annotated[Path, typer.Option("--out", metavar="DIR", help="Directory to write to.")]
OutFile = Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
EngineOption = Annotated[
    Engine,
    typer.Option("--engine", help="ray: describe on the Ray cluster that RAY_ADDRESS names, else on this machine."),
]
Method = Annotated[str, typer.Option("--method", metavar="METHOD", help="A run directory, or sad, hog, ...")]
Conditions = Annotated[
    str, typer.Option("--conditions", metavar="A,B", help="Traverses or conditions that take part [all].")
]
Frames = Annotated[
    str,
    typer.Option("--frames", metavar="A:B", help="Places by position, after the filters; either side may be left out."),
]
DropDark = Annotated[bool, typer.Option("--drop-dark", help="Leave out places that are dark in any traverse.")]
DropStationary = Annotated[
    bool, typer.Option("--drop-stationary", help="Leave out places that look like the last one kept, as at stops.")
]
ImageSize = Annotated[
    tuple[int, int] | None,
    typer.Option("--image-size", metavar="H W", help="Height and width in pixels, multiples of 32."),
]
AnySize = Annotated[
    tuple[int, int] | None, typer.Option("--image-size", metavar="H W", help="Height and width in pixels.")
]
QueryFrames = Annotated[
    str,
    typer.Option("--query-frames", metavar="A:B", help="Of the places those that ask; all of them are the map [all]."),
]
Grey = Annotated[bool, typer.Option("--grey", help="Use grey images.")]
Epochs = Annotated[int | None, typer.Option("--epochs", min=1, help="Passes over the training frames.")]
Minutes = Annotated[float | None, typer.Option("--minutes", help="Stop after so many minutes of training.")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Of weights, order, noise and augmentation.")]
Query = Annotated[str, typer.Option("--query", metavar="COND", help="Condition or traverse that asks.")]
Database = Annotated[str, typer.Option("--database", metavar="COND", help="Condition or traverse that is the map.")]
Tolerance = Annotated[
    int | None,
    typer.Option("--tolerance", min=0, metavar="T", help="Places by which a match may be off [route.toml, else 1]."),
]
Radius = Annotated[
    float | None,
    typer.Option("--radius", metavar="METRES", help="Metres by which a match may be off, instead of --tolerance."),
]
Standardise = Annotated[
    Standardisation | None,
    typer.Option(
        "--standardise",
        help="Subtract each traverse's mean (full: and divide by its spread; running: the mean so far).",
    ),
]
Sequence = Annotated[
    int, typer.Option("--sequence", min=1, metavar="L", help="Score places by the last L frames, not by one.")
]
SequenceSearch = Annotated[
    SequenceMethod,
    typer.Option(
        "--sequence-method",
        help="How --sequence does it: filter follows any motion, and frames of a stop do not count among the L; "
        "seqslam wants an even speed, mean the map's own.",
    ),
]

SourceOptions = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="An option of the kind; may be given several times."),
]


def given_pairs(given: list[str] | None) -> dict[str, str]:
    """Reads what `--set` gave, `NAME=VALUE` each.

    Raises:
        ConfigError: There is no `=`, or a name comes twice.
    """
    pairs: dict[str, str] = {}
    for text in given or []:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"--set {text!r} is not NAME=VALUE; write it like --set size=64x32")
        if name in pairs:
            raise ConfigError(f"--set {name} is given twice; keep one (a list's items are separated by commas)")
        pairs[name] = value
    return pairs


def split_names(text: str, option: str = "") -> tuple[str, ...]:
    """Reads `A,B`.

    Args:
        text: What was given.
        option: The option that gave it, if it must name something unless it is left out.

    Raises:
        ConfigError: It names nothing.
    """
    names = tuple(name for name in text.split(",") if name)
    if text and not names and option:
        raise ConfigError(f"{option} {text!r} names nothing; write names separated by commas, such as summer,winter")
    return names


def only_given(**options: Any) -> dict[str, Any]:
    """The options that were given: without those that are None, False or empty."""
    return {
        name: value
        for name, value in options.items()
        if value is not None and value is not False and value not in ("", ())
    }
