"""`everplace data import` and `everplace data list`: routes from data sets and recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from everplace.cli.option_names import with_options
from everplace.cli.options import Json, OutDirectory, SourceOptions, given_pairs
from everplace.cli.output import require_directory, show_progress, show_result, warn

__all__ = ["import_", "list_"]


def import_(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="What it is; see everplace data list.")],
    source: Annotated[Path, typer.Argument(metavar="SOURCE", help="The directory, archive or recording.")],
    out: OutDirectory,
    options: SourceOptions = None,
    copy: Annotated[bool, typer.Option("--copy", help="Copy image files instead of linking to them.")] = False,
    as_json: Json = False,
) -> None:
    """Turn a data set or recordings into a route.

    Example: everplace data import nordland downloads/nordland --out my-route --set preset=27592
    """
    from everplace.importing.import_route import import_route

    require_directory(out)
    summary = import_route(kind, source, out, given_pairs(options), copy=copy, progress=show_progress())
    result: dict[str, Any] = {
        "route": str(out),
        "traverses": dict(summary.traverses),
        "frames": summary.frames,
        "linked": summary.linked,
        "tolerance": summary.tolerance,
        "radius": summary.radius,
        "protocol": summary.protocol or None,
    }
    if as_json:
        result["notes"] = [with_options(note) for note in summary.notes]
    else:
        for note in summary.notes:
            warn(note)
    show_result(result, as_json)


def list_(as_json: Json = False) -> None:
    """List the kinds of sources that can be imported, with their options, and the data sets that can be fetched.

    Example: everplace data list
    """
    from everplace.importing.catalogue import DATA_SETS
    from everplace.importing.kinds import missing_extras, source_kinds
    from everplace.settings import explanations

    kinds: dict[str, dict[str, Any]] = {
        name: {
            "summary": kind.SUMMARY,
            "missing": [f"pip install 'everplace[{extra}]'" for extra in missing_extras(kind)],
            "options": explanations(kind.Options),
            "data_sets": {
                one.name: {"summary": one.summary, "licence": one.licence, "unavailable": one.unavailable}
                for one in DATA_SETS
                if one.kind == name
            },
        }
        for name, kind in source_kinds().items()
    }
    if as_json:
        show_result(kinds, as_json)
        return
    for name, kind in kinds.items():
        print(f"{name}: {kind['summary']}")
        for option, text in kind["options"].items():
            print(f"    --set {option}=...  {text}")
        for data_set, about in kind["data_sets"].items():
            if about["unavailable"]:
                print(f"    {data_set} cannot be fetched: {about['summary']}")
            else:
                print(f"    everplace data fetch {data_set}  {about['summary']}")
        if kind["missing"]:
            print(f"    part of it needs {', '.join(kind['missing'])}")
