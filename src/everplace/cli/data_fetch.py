"""`everplace data fetch`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from everplace.cli.options import Json
from everplace.cli.output import require_directory, show_progress, show_result, warn
from everplace.errors import ConfigError

if TYPE_CHECKING:
    from everplace.importing.catalogue import DataSet
    from everplace.importing.dataset_fetching import Fetched

__all__ = ["fetch"]


def fetch(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="nordland64, nordland, nordland-olid, gardens-point, ...")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where to put it [$EVERPLACE_CACHE, else the user's cache]."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Agree to the licence; nobody is asked.")] = False,
    as_json: Json = False,
) -> None:
    """Download a data set of the field; what was broken off goes on where it stopped.

    Example: everplace data fetch gardens-point --yes
    """
    from everplace.importing.catalogue import find_data_set
    from everplace.importing.dataset_fetching import default_directory, fetch_data_set

    data_set = find_data_set(name)
    directory = default_directory(data_set) if out is None else out
    require_directory(directory)
    # Stdout is kept for the result.
    for line in (data_set.summary, f"licence: {data_set.licence}", f"cite: {data_set.citation}"):
        print(line, file=sys.stderr)
    if not yes:
        if not sys.stdin.isatty():
            raise ConfigError(f"nobody can be asked whether the licence of {name} is agreed to; read it and give --yes")
        if not typer.confirm(f"Agree, and download it to {directory}?", err=True):
            warn("nothing was fetched")
            return
    fetched = fetch_data_set(data_set, directory, show_progress())
    result: dict[str, Any] = {
        "name": data_set.name,
        "directory": str(fetched.directory),
        "bytes": sum(file.size or 0 for file in fetched.files),
        "licence": data_set.licence,
        "citation": data_set.citation,
        "next": _next(data_set, fetched),
    }
    if as_json:
        result["files"] = [
            {"name": file.name, "bytes": file.size, "sha256": file.sha256, "published": file.published}
            for file in fetched.files
        ]
    else:
        result["files"] = [file.name for file in fetched.files]
    if not all(file.published for file in fetched.files):
        warn(f"no hash is published for {name}; the one found is written down and wanted from now on")
    show_result(result, as_json)


def _next(data_set: DataSet, fetched: Fetched) -> str:
    """The command that turns what was fetched into a route."""
    return f"everplace data import {data_set.kind} {shlex.quote(str(fetched.directory))} --out my-route"
