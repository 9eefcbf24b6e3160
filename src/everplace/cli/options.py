"""Options that several commands share, so that they mean and read the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

__all__ = [
    "AnySize", "Database",
    "DropDark", "DropStationary", "Epochs", "Frames", "Grey", "ImageSize", "Json", "Minutes", "OutDirectory",
    "OutFile", "Query", "Radius", "RouteArgument", "Seed", "Sequence", "SequenceSearch", "Standardise", "Tolerance",
]  # fmt: skip

RouteArgument = Annotated[Path, typer.Argument(metavar="ROUTE", help="Directory with one sub-directory a traverse.")]
OutDirectory = Annotated[Path, typer.Option("--out", metavar="DIR", help="Directory to write to.")]
OutFile = Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Frames = Annotated[
    str,
    typer.Option("--frames", metavar="A:B", help="Places by position, after the filters; either side may be left out."),
]
DropDark = Annotated[bool, typer.Option("--drop-dark", help="Leave out places that are dark in any traverse.")]
DropStationary = Annotated[
    bool, typer.Option("--drop-stationary", help="Leave out places that look like the last one kept, as at stops.")
]
ImageSize = Annotated[
    Optional[tuple[int, int]],  # noqa: UP045
    typer.Option("--image-size", metavar="H W", help="Height and width in pixels, multiples of 32."),
]
AnySize = Annotated[
    Optional[tuple[int, int]],  # noqa: UP045
    typer.Option("--image-size", metavar="H W", help="Height and width in pixels."),
]
Grey = Annotated[bool, typer.Option("--grey", help="Use grey images.")]
Epochs = Annotated[Optional[int], typer.Option("--epochs", min=1, help="Passes over the training frames.")]  # noqa: UP045
Minutes = Annotated[Optional[float], typer.Option("--minutes", help="Stop after so many minutes of training.")]  # noqa: UP045
Seed = Annotated[Optional[int], typer.Option("--seed", min=0, help="Of weights, order, noise and augmentation.")]  # noqa: UP045
Query = Annotated[str, typer.Option("--query", metavar="COND", help="Condition or traverse that asks.")]
Database = Annotated[str, typer.Option("--database", metavar="COND", help="Condition or traverse that is the map.")]
Tolerance = Annotated[
    Optional[int],  # noqa: UP045
    typer.Option("--tolerance", min=0, metavar="T", help="Places by which a match may be off [route.toml, else 1]."),
]
Radius = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option("--radius", metavar="METRES", help="Metres by which a match may be off, instead of --tolerance."),
]
Standardise = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(
        "--standardise", metavar="centre|full", help="Subtract each traverse's mean (full: and divide by its spread)."
    ),
]
Sequence = Annotated[
    int,
    typer.Option(
        "--sequence",
        min=1,
        metavar="L",
        help="Score places by the last L frames, not by one.",
    ),
]
SequenceSearch = Annotated[
    str,
    typer.Option(
        "--sequence-method",
        metavar="filter|seqslam|mean",
        help="How --sequence does it: filter follows any motion, and frames of a stop do not count among the L; "
        "seqslam wants an even speed, mean the map's own.",
    ),
]
