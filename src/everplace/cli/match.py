"""`everplace match`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from everplace.choices import MatchFormat
from everplace.cli.option_groups import MatchingOptions, grouped
from everplace.cli.options import Json, OutFile
from everplace.cli.output import (
    require_file,
    require_other,
    show_result,
    warn,
)
from everplace.errors import ConfigError
from everplace.files import STANDARD_OUTPUT, readable

if TYPE_CHECKING:
    from everplace.describe.files.descriptors import Descriptors

__all__ = ["match"]


@grouped
def match(
    database: Annotated[Path, typer.Argument(metavar="DATABASE.h5", help="Descriptors of the map.")],
    query: Annotated[Path, typer.Argument(metavar="QUERY.h5", help="Descriptors of the frames that ask.")],
    *,
    out: OutFile,
    top: Annotated[int, typer.Option("--top", min=1, metavar="K", help="Matches for each query.")] = 1,
    how: MatchingOptions,
    min_probability: Annotated[
        float | None,
        typer.Option(
            "--min-probability",
            min=0.0,
            max=1.0,
            metavar="P",
            help="Write matches of at least this probability only; needs --sequence with the filter, or fabmap.",
        ),
    ] = None,
    exclude: Annotated[
        int | None,
        typer.Option(
            "--exclude",
            min=1,
            metavar="N",
            help="Frames nearer than N are no match, where DATABASE and QUERY are one drive: finds loops.",
        ),
    ] = None,
    kind: Annotated[MatchFormat, typer.Option("--format", help="Kind of file.")] = "csv",
    as_json: Json = False,
) -> None:
    """Find the most similar database frames of every query.

    FILE may be - for standard output. As csv it holds the names (stems) of the frames, as hloc-pairs and kapture the
    names of the image files.

    The column score_kind says what a score is. Where the probability is known that the database does not hold a place
    at all, hloc-pairs leaves out the frames for which it is over one half.

    Example: everplace match summer.h5 winter.h5 --top 5 --out matches.csv
    """
    if out == STANDARD_OUTPUT and as_json:
        raise ConfigError("--out - and --json exclude each other: both write to standard output; give one of them")
    if out != STANDARD_OUTPUT:
        require_file(out)
    for given in (database, query):
        require_other(out, given)
    from everplace.describe.files.descriptors import load_descriptors
    from everplace.match.match_file import write_matches
    from everplace.match.matching import find_matches
    from everplace.match.new_place import new_place_summary

    asked, known = load_descriptors(query), load_descriptors(database)
    found = find_matches(asked, known, top, how.matching(), exclude=exclude)
    accepted = found.accepted(min_probability)
    if kind == "hloc-pairs" and found.on_map is not None:
        accepted &= (found.on_map >= 0.5)[:, None]
    asked_names, known_names = (
        described.names if kind == "csv" else _image_names(described, path, kind)
        for described, path in ((asked, query), (known, database))
    )
    if kind != "csv" and query.resolve() != database.resolve() and not set(asked_names).isdisjoint(known_names):
        warn(
            f"{readable(query)} and {readable(database)} call images alike, so {kind} cannot tell them apart; describe "
            "both with one --image-root that holds the two directories"
        )
    write_matches(
        out, asked_names, known_names, found.indices, found.scores,
        format=kind, kind=found.kind, accepted=accepted,
    )  # fmt: skip
    if out == STANDARD_OUTPUT:
        return
    result: dict[str, Any] = {
        "queries": len(asked),
        "database": len(known),
        "matches": int(accepted.sum()),
        "queries_without_match": int((~accepted.any(axis=1)).sum()),
        "score_kind": found.kind,
        "out": str(out),
    }
    if (new_place := new_place_summary(asked, known)) is not None:
        result["new_place"] = new_place
    show_result(result, as_json)


def _image_names(described: Descriptors, path: Path, kind: MatchFormat) -> tuple[str, ...]:
    """What hloc and kapture call the frames; of a file that does not say it, the names of the frames."""
    if described.image_names is not None:
        return described.image_names
    warn(
        f"{readable(path)} does not hold the names of its image files, so its `names` are written; if {kind} is to "
        "find the images by them, make it again with `everplace describe`"
    )
    return described.names
