"""`everplace export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from everplace.cli.option_groups import RouteOptions, grouped
from everplace.cli.options import Json
from everplace.cli.output import require_file, show_progress, show_result, warn

__all__ = ["export"]

_MOST_LOST = 0.01


@grouped
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Directory of a run, or of a map.")],
    *,
    onnx: Annotated[Path, typer.Option("--onnx", metavar="FILE", help="File to write, ending in .onnx.")],
    int8: Annotated[bool, typer.Option("--int8", help="Compute in 8 bits, calibrated on the route.")] = False,
    route: Annotated[
        Path | None,
        typer.Option("--route", metavar="ROUTE", help="Compare auc_pr on it, its second traverse asking the first."),
    ] = None,
    places: RouteOptions,
    as_json: Json = False,
) -> None:
    """Write a run's encoder as an ONNX network, and beside it the TOML with which onnx:FILE describes images.

    Example: everplace export runs/adapted --onnx adapted.onnx --int8 --route my-route --conditions summer,winter
    """
    require_file(onnx, (".onnx",), option="--onnx")
    from everplace.experiments.exported_run import export_run

    chosen = None if route is None else places.chosen(route)
    written = export_run(run, onnx, int8=int8, route=chosen, selection=places.selection(), progress=show_progress())
    if int8 and chosen is None:
        warn("without --route the 8-bit ranges were measured on rendered frames; give one for better ranges")
    if written.auc_pr is not None and written.auc_pr[1] < written.auc_pr[0] - _MOST_LOST:
        ours, theirs = written.auc_pr
        warn(f"the exported network loses {ours - theirs:.3f} of auc_pr on the route; export it without --int8")
    show_result(written.summary(), as_json)
