"""`everplace demo`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from everplace.cli.options import Json
from everplace.cli.output import provenance, require_directory, show_progress, show_result

__all__ = ["demo"]


def demo(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Directory for the route, runs and report.")] = Path(
        "demo"
    ),
    as_json: Json = False,
) -> None:
    """Render a route, train C-VAE and CP-VAE (both recipes), compare them with SAD and HOG; 2 to 5 minutes on 2 cores.

    Example: everplace demo --out demo
    """
    require_directory(out)
    from everplace.experiments.rendered_demo import MAP, run_demo

    metrics = run_demo(out, details=provenance(), progress=show_progress())
    if as_json:
        show_result(metrics, as_json=True)
        return
    for label, area in metrics["mean_auc_pr"].items():
        print(f"{label:<11} auc_pr {area:.3f}")
    print(f"report: {out / 'report.html'}")
    print(f"a map of the summer, to look at in a browser: everplace serve {shlex.quote(str(out / MAP))}")
