"""`everplace match`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from everplace.cli.options import Json, OutFile, Sequence, SequenceSearch, Standardise
from everplace.cli.output import one_of, require_file, show_result

__all__ = ["match", "register"]


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("match")(match)


def match(
    database: Annotated[Path, typer.Argument(metavar="DATABASE.h5", help="Descriptors of the map.")],
    query: Annotated[Path, typer.Argument(metavar="QUERY.h5", help="Descriptors of the frames that ask.")],
    out: OutFile,
    top: Annotated[int, typer.Option("--top", min=1, metavar="K", help="Matches for each query.")] = 1,
    standardise: Standardise = None,
    sequence: Sequence = 1,
    sequence_method: SequenceSearch = "filter",
    file_format: Annotated[
        str, typer.Option("--format", metavar="csv|hloc-pairs|kapture", help="Kind of file.")
    ] = "csv",
    as_json: Json = False,
) -> None:
    """Find the most similar database frames of every query.

    Example: everplace match summer.h5 winter.h5 --top 5 --out matches.csv
    """
    how = one_of(standardise, "--standardise", ("centre", "full"))
    search = one_of(sequence_method, "--sequence-method", ("filter", "seqslam", "mean"))
    kind = one_of(file_format, "--format", ("csv", "hloc-pairs", "kapture"))
    require_file(out)
    from everplace.describe.descriptors import load_descriptors
    from everplace.match.io import write_matches
    from everplace.match.place_posterior import new_place_summary
    from everplace.match.search import best_matches

    asked, known = load_descriptors(query), load_descriptors(database)
    indices, scores = best_matches(asked, known, top, standardised=how, sequence=sequence, sequence_method=search)
    write_matches(out, asked.names, known.names, indices, scores, format=kind)
    result = {"queries": len(asked), "database": len(known), "matches": indices.size, "out": str(out)}
    if (new_place := new_place_summary(asked, known)) is not None:
        result["new_place"] = new_place
    show_result(result, as_json)
